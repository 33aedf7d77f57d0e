"""Uniform stands on level ground: what the lab and the calibration of `empirical` look at."""

from swath.core.random import Stream
from swath.field.crop import Crop
from swath.field.edges.edge import StraightEdge, make_edge
from swath.field.field import Field, make_field
from swath.field.field_setup import FieldSetup
from swath.field.memory_layout import PlantLibrary
from swath.field.stand import uniform
from swath.field.terrain import plane
from swath.field.weather import SiteWeather


def level_stand(
    crop: Crop,
    density: float,
    stream: Stream,
    *,
    height: float | None = None,
    sheet: str = "",
    library: PlantLibrary | None = None,
    cut_at: float | None = None,
    edge: StraightEdge | None = None,
    weather: SiteWeather | None = None,
) -> Field:
    """Crop, or its stubble, all around the origin, drilled as its sheet says.

    density: stems/m2, of few plants the library holds a little more; height: of the crop [m], None = the
    sheet's; sheet: name or file of the crop's data sheet, "" = that of its name; library: plants to use
    cut_at: height of stubble [m], to the centimetre; None = the crop stands
    edge: of the crop, None = there is none near
    """
    setup = FieldSetup()
    params = uniform.Params(
        crop=sheet or crop.name,
        stems_per_m2=density,
        row_spacing_m=crop.stand.row_spacing if library is None else library.row_spacing,
        height_factor=1.0 if height is None else height / crop.stand.height,
    )
    begins, stubble = (None, 0.0) if cut_at is None else (400.0, cut_at)
    line = StraightEdge(
        x_m=-200.0, y_m=-200.0, length_m=400.0, crop_begins_m=begins, stubble_height_m=stubble
    )
    ground, stand = plane.Plane(plane.Params(), setup), uniform.Uniform(params, setup)
    made = make_edge(edge or line, setup)
    return make_field(ground, stand, made, crop=crop, library=library, stream=stream, weather=weather)
