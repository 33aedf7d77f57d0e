"""A field with everything that rays can meet at once."""

import numpy as np

from swath.field.crop_sheet import Weeds
from swath.field.stand import maps
from swath.field.terrain import formula
from tests.field.made_field import made_field, rectangle


def make_hills():
    """Slope, waves, roughness; varied and lodged crop with weeds; a cut strip with straw; crop cut high."""
    stand = maps.Params(
        stems_per_m2=500.0,
        row_azimuth_deg=20.0,
        lean_deg=8.0,
        patches=(maps.Patch(x_m=6.0, y_m=8.0, radius_m=2.5, lean_deg=60.0),),
        density_variation=maps.Variation(),
        height_variation=maps.Variation(),
        weeds=Weeds(),
    )
    terrain = formula.Params(
        slope_percent=12.0,
        slope_azimuth_deg=40.0,
        waves=(formula.Wave(amplitude_m=0.3, wavelength_m=9.0, azimuth_deg=70.0),),
        roughness_class="C",
    )
    made = made_field(terrain=terrain, stand=stand)
    made.ensure(5.0, 6.0, 45.0)
    made.cut(rectangle(3.0, 0.0, 5.0, 9.0), 0.15)
    made.cut(rectangle(5.0, 3.0, 5.5, 7.3), 0.40)
    made.deposit_straw(rectangle(3.5, 0.0, 4.5, 8.0), 6.0)
    return made


def over(field, x, y, height):
    """A place above the soil."""
    return np.array([x, y, float(np.asarray(field.ground_height(x, y))) + height])
