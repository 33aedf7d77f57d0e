"""One known harvest in the forms in which people hold it, with and without units."""

import csv
import re
from datetime import datetime, timedelta

import numpy as np
import shapefile

from swath.field.maps.projection import Origin, transform, utm_epsg

FT, LB, ACRE, MPH = 0.3048, 0.45359237, 4046.8564224, 0.44704
BUSHEL = {"wheat": 60 * LB, "maize": 56 * LB, "soy": 60 * LB}
DRY = {"wheat": 0.135, "maize": 0.155, "soy": 0.13}


class Harvest:
    """Passes there and back, `azimuth_deg` from north, 20 s between them; an entry per record, shape (n,).

    t [s]; lat, lon [deg]; z [m]; flow at the sensor [kg/s], late [s] behind the cut; wet: what a monitor
    makes of it, as harvested [kg/m2]; moisture: share of the wet mass
    """

    def __init__(
        self, lat=48.0, lon=11.0, *, width=9.0, speed=2.0, level=0.54, moisture=0.14, passes=8, length=180.0,
        seed=1, begun=datetime(2024, 7, 20, 10), z=300.0, interval=1.0, late=0,
        azimuth_deg=0.0,
    ):  # fmt: skip
        self.width, self.speed, self.moisture = width, speed, moisture
        self.begun, self.late, self.passes = begun, late, passes
        rng = np.random.default_rng(seed)
        rows, t = [], 0.0
        for p in range(passes):
            along = np.arange(0.0, length, speed * interval)
            for y in along if p % 2 == 0 else along[::-1]:
                rows.append((t, p * width, y))
                t += interval
            t += 20.0
        self.t, x, y = np.array(rows).T
        epsg = utm_epsg(lon, lat)
        east, north = transform([[lon, lat]], "EPSG:4326", f"EPSG:{epsg}")[0]
        turn = np.radians(azimuth_deg)
        right, ahead = (np.cos(turn), -np.sin(turn)), (np.sin(turn), np.cos(turn))
        local = np.outer(x, right) + np.outer(y, ahead)
        self.lon, self.lat = Origin(epsg, east, north).to_lon_lat(local).T
        self.course = (azimuth_deg + 180.0 * (np.rint(x / width) % 2)) % 360.0
        self.z = z + 0.01 * x + 0.02 * y
        waves = sum(0.07 * np.sin(x / a + y / b + p) for a, b, p in ((40, 90, 1), (70, -23, 2), (-31, 37, 3)))
        grown = level * (1 + waves) * (1 + 0.03 * rng.standard_normal(len(x)))
        arrived = np.searchsorted(self.t, self.t - late - 1e-9)
        self.wet = np.where(self.t[arrived] <= self.t - late + 1e-9, grown[arrived], 0.0)
        self.flow, self.one = self.wet * width * speed, np.ones(len(x))

    def __len__(self):
        return len(self.t)

    @property
    def when(self):
        return [self.begun + timedelta(seconds=float(t)) for t in self.t]

    def places(self, names=("Latitude", "Longitude")):
        return {names[0]: np.round(self.lat, 8), names[1]: np.round(self.lon, 8)}

    def dry(self, crop="wheat"):
        """Yield of dry grain [kg/m2]."""
        return self.wet * (1 - self.moisture) / (1 - DRY[crop])

    def bushels(self, crop="wheat"):
        """Dry yield [bu/ac]."""
        return self.dry(crop) * ACRE / BUSHEL[crop]


def table(path, columns, separator=","):
    """Text; a cell is text as it is or a number of eight decimals."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, delimiter=separator)
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow([v if isinstance(v, str) else f"{v:.8f}" for v in row])
    return path


def shapes(path, harvest, columns):
    """Point shapefile; names as dBASE cuts them."""
    path.mkdir()
    with shapefile.Writer(path / "log", shapeType=shapefile.POINT) as made:
        for name, values in columns.items():
            made.field(
                re.sub(r"\W", "_", name)[:10], *(("C", 40) if isinstance(values[0], str) else ("N", 20, 8))
            )
        for i in range(len(harvest)):
            made.point(harvest.lon[i], harvest.lat[i])
            made.record(*[values[i] for values in columns.values()])
    return path / "log.shp"


def stamps(harvest, form="%Y-%m-%d %H:%M:%S"):
    return [when.strftime(form) for when in harvest.when]


def deere(path, h, *, us=True, mass=10.0, crop="Wheat", fields=("Distance", "SwathWidth", "Speed")):
    """Names of the Operations Center, no unit anywhere. mass: factor of the yield where not us."""
    length, speed = (FT, MPH) if us else (1.0, 1 / 3.6)
    distance, width, pace = fields
    kind = {"Wheat": "wheat", "Corn": "maize", "Soybeans": "soy"}[crop]
    grain = {"VRYIELDVOL": h.bushels(kind)} if us else {"WetMass": h.wet * mass}
    return shapes(path, h, {
        distance: h.one * h.speed / length, width: h.one * h.width / length, **grain,
        "Moisture": 100 * h.moisture * h.one, pace: h.one * h.speed / speed, "Elevation": h.z / length,
        "Time": stamps(h), "Crop": [crop] * len(h),
    })  # fmt: skip


def deere_metric(path, h, *, mass=10.0, sections=1):
    """Operations Center with its own three columns, in metres; a record per section."""
    columns = {
        "DISTANCE": h.speed * h.one, "SWATHWIDTH": h.width / sections * h.one, "VRYIELDVOL": h.dry() * mass,
        "Crop": ["Wheat"] * len(h), "WetMass": h.wet * mass, "Moisture": 100 * h.moisture * h.one,
        "Elevation": h.z, "IsoTime": [f"{s}.000Z" for s in stamps(h, "%Y-%m-%dT%H:%M:%S")],
    }  # fmt: skip
    if sections > 1:
        columns["SECTIONID"] = np.zeros(len(h))
    path.mkdir()
    with shapefile.Writer(path / "log", shapeType=shapefile.POINT) as made:
        for name, values in columns.items():
            made.field(name, *(("C", 40) if isinstance(values[0], str) else ("N", 20, 8)))
        for i in range(len(h)):
            for section in range(sections):
                made.point(h.lon[i], h.lat[i])
                row = {k: v[i] for k, v in columns.items()} | ({"SECTIONID": section} if sections > 1 else {})
                made.record(*[row[k] for k in columns])
    return path / "log.shp"


def sms(path, h, *, us=True, grain=("Crop_Flw_M", "Yld_Mass_W", "Yld_Vol_Dr"), drop=()):
    """SMS shapefile, names cut to ten letters; widths, heights and flows without a unit."""
    length = FT if us else 1.0
    per = {"Crop_Flw_M": LB if us else 1 / 3.6, "Yld_Mass_W": LB / ACRE if us else 0.1}
    everything = {
        "Obj__Id": np.arange(1.0, len(h) + 1), "Distance_f" if us else "Distance_m": h.one * h.speed / length,
        "Track_deg_": 0 * h.one, "Duration_s": h.one, "Elevation_": h.z / length, "Time": stamps(h),
        "Swth_Wdth_": h.one * h.width / length, "Moisture__": 100 * h.moisture * h.one,
        "Speed_mph_" if us else "Speed_km_h": h.one * h.speed / (MPH if us else 1 / 3.6), "Pass_Num": h.one,
        "Crop_Flw_M": h.flow / per["Crop_Flw_M"], "Yld_Mass_W": h.wet / per["Yld_Mass_W"],
        "Yld_Vol_Dr": h.bushels() if us else h.dry() * 10,
    }  # fmt: skip
    left = {"Crop_Flw_M", "Yld_Mass_W", "Yld_Vol_Dr"} - set(grain) | set(drop)
    return shapes(path, h, {k: v for k, v in everything.items() if k not in left})


def ag_leader(path, h, *, width="in", height=FT, status=("33", "32"), drop=(), crop="Wheat"):
    """Ag Leader, no header line. width: unit; status: of the header down, up; drop: columns left out."""
    size = {"in": 0.0254, "ft": FT, "cm": 0.01}[width]
    rows = [
        [f"{h.lon[i]:.8f}", f"{h.lat[i]:.8f}", f"{h.flow[i] / LB:.4f}", str(int(485916 + h.t[i])), "1",
         f"{h.speed / 0.0254:.2f}", f"{h.width / size:.2f}", f"{100 * h.moisture:.1f}", status[0], "1", "0",
         "End Rows", "1", crop, "2", "3.2", f"{h.z[i] / height:.2f}"]
        for i in range(len(h))
    ]  # fmt: skip
    path.write_text("\n".join(",".join(c for k, c in enumerate(r) if k not in drop) for r in rows))
    return path
