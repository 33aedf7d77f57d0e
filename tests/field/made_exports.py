"""The made log in the forms in which programs of makers and advisers write theirs."""

from datetime import datetime, timedelta

import numpy as np
import shapefile

from swath.field.maps.projection import Origin
from tests.field.made_log import EAST, EPSG, HEADER, NORTH, SPEED, MadeLog

FT, LB, ACRE = 0.3048, 0.45359237, 4046.8564224
BEGUN = datetime(2023, 9, 19, 13, 58, 30)
WGS84 = (
    'GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137,298.257223563]],'
    'PRIMEM["Greenwich",0],UNIT["Degree",0.017453292519943295]]'
)


def rows(passes=6, **options):
    """(lon, lat, row of the made log, date and time) of each record in driven order."""
    made = MadeLog(passes=passes, **options)
    local = np.array([[row["easting"] - EAST, row["northing"] - NORTH] for row in made.rows])
    places = Origin(EPSG, EAST, NORTH).to_lon_lat(local)
    for (lon, lat), row in zip(places, made.rows, strict=True):
        yield lon, lat, row, BEGUN + timedelta(seconds=row["time"])


def wet_yield(row):
    """Yield as harvested [kg/m2], as a monitor computes it."""
    return row["flow"] / (SPEED * HEADER)


def john_deere(folder, *, crop="Winter Wheat", sections=3, share=1.0, mass=ACRE / LB, metadata=""):
    """Shapefile of the Operations Center: a record per section of the header, feet, pounds per acre (or mass
    [m2/kg] of another unit).
    """
    folder.mkdir()
    with shapefile.Writer(
        folder / "Home-North-Harvest", shapeType=shapefile.POINT, encoding="cp1252"
    ) as made:
        for name in ("DISTANCE", "SWATHWIDTH", "VRYIELDVOL", "SECTIONID"):
            made.field(name, "N", 20, 8)
        made.field("Crop", "C", 40)
        for name in ("WetMass", "Moisture", "Elevation"):
            made.field(name, "N", 20, 6)
        for name in ("Time", "VARIETY", "IsoTime"):
            made.field(name, "C", 40)
        for lon, lat, row, when in rows():
            wet = share * wet_yield(row)
            for section in range(sections):
                made.point(lon, lat)
                made.record(
                    SPEED / FT, HEADER / FT / sections, wet * ACRE / LB / 60, section, crop, wet * mass,
                    row["moisture"],
                    row["elevation"] / FT, when.strftime("%m/%d/%Y %I:%M:%S %p"), "Körner",
                    when.strftime("%Y-%m-%dT%H:%M:%S.000Z"),
                )  # fmt: skip
    (folder / "Home-North-Harvest.prj").write_text(WGS84)
    if metadata:
        (folder / "Home-North-Harvest-Deere-Metadata.json").write_text(metadata)
    return folder / "Home-North-Harvest.shp"


def write(path, header, lines, *, encoding="utf-8", separator=","):
    text = [separator.join(header)] if header else []
    path.write_text(
        "\n".join([*text, *(separator.join(map(str, line)) for line in lines)]), encoding=encoding
    )
    return path


def sms(path, *, clock="%I:%M:%S %p", crop="WINTER WHEAT"):
    """Text of SMS or Apex: Date and Time apart, feet, pounds per second."""
    header = [
        "Longitude", "Latitude", "Field", "Product", "Obj. Id", "Distance(ft)", "Swth Wdth(ft)",
        "Crop Flw(M)(lb/s)", "Moisture(%)", "Elevation(ft)", "Date", "Time",
    ]  # fmt: skip
    lines = (
        (f"{lon:.8f}", f"{lat:.8f}", "North", crop, i, SPEED / FT, HEADER / FT, row["flow"] / LB,
         row["moisture"], row["elevation"] / FT, when.strftime("%m/%d/%Y"), when.strftime(clock))
        for i, (lon, lat, row, when) in enumerate(rows())
    )  # fmt: skip
    return write(path, header, lines)


def farm_platform(path):
    """Snake case with units, bushels of dry wheat at 13.5 %."""
    header = [
        "lat_wgs84", "lng_wgs84", "dry_yield_bu_ac", "moisture_pct", "swath_width_ft", "speed_mph",
        "crop_type", "timestamp_utc",
    ]  # fmt: skip
    lines = (
        (f"{lat:.8f}", f"{lon:.8f}",
         wet_yield(row) * (1 - row["moisture"] / 100) / 0.865 * ACRE / (60 * LB),
         row["moisture"], HEADER / FT, SPEED / 0.44704, "wheat", when.isoformat() + "Z")
        for lon, lat, row, when in rows()
    )  # fmt: skip
    return write(path, header, lines)


def german(path, crop="Winterweizen"):
    """Semicolons, decimal commas, umlauts in the code page of Windows."""
    header = [
        "Datum", "Uhrzeit", "Breite", "Länge", "Ertrag [t/ha]", "Kornfeuchte [%]", "Arbeitsbreite [m]",
        "Geschwindigkeit [km/h]", "Höhe [m]", "Fruchtart",
    ]  # fmt: skip
    lines = (
        [str(cell).replace(".", ",") if i > 1 else cell for i, cell in enumerate((
            when.strftime("%d.%m.%Y"), when.strftime("%H:%M:%S"), round(lat, 8), round(lon, 8),
            10 * wet_yield(row), row["moisture"], HEADER, 3.6 * SPEED, row["elevation"], crop,
        ))]
        for lon, lat, row, when in rows()
    )  # fmt: skip
    return write(path, header, lines, encoding="cp1252", separator=";")


def ag_leader(path, *, crop="Wheat", share=1.0, serial=2004013):
    """Ag Leader advanced: 17 columns, no header line, inches; header status 33 is down."""
    lines = (
        (f"{lon:.8f}", f"{lat:.8f}", f"{share * row['flow'] / LB:.4f}", int(1.6e9 + row["time"]), 1,
         f"{SPEED / 0.0254:.2f}", f"{HEADER / 0.0254:.1f}", row["moisture"], 33, 1, serial, '"F1:North"',
         '"L1:<1>"', f'"{crop}"', 7, 1.2, row["elevation"] / FT)
        for lon, lat, row, when in rows()
    )  # fmt: skip
    return write(path, [], lines)
