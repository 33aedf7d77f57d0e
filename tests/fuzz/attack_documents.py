"""Attacks by documents, archives, models, pictures and meshes."""

import io
import json
import os
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.abroad_kinds import KML, RING, SDF, URDF
from tests.fuzz.attack import ACTED, PORT, RAN, WRITE, Attack, sparse
from tests.fuzz.attack_logs import CODE_RUNS, DRIVE, GIB
from tests.fuzz.command_kinds import _field_and_dem
from tests.fuzz.measured_kinds import SCENARIO

WEB = f"http://127.0.0.1:{PORT}/a"
SECRET = "../secret.txt"
LAUGHS = "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10 if k else "ha" * 50}">' for k in range(12))
BOMB = f"<!DOCTYPE x [{LAUGHS}]>"
SQUARE = f'<!DOCTYPE x [<!ENTITY a11 "{"a" * 1_000_000}">]>'
OUTSIDE = f'<!DOCTYPE x [<!ENTITY a11 SYSTEM "file://SECRET"><!ENTITY % b SYSTEM "{WEB}"> %b;]>'
ELSEWHERE = f'<!DOCTYPE x SYSTEM "{WEB}">'


def _with_entities(text: str, head: str, times: int = 1) -> str:
    """An XML text whose names have an entity; behind its head."""
    first, _, rest = text.partition("?>") if text.startswith("<?xml") else ("", "", text)
    put = rest.replace("Hill", "&a11;" * times).replace('name="m"', 'name="m&a11;"', 1)
    return f"{first}{'?>' if first else ''}{head}{put}"


def file_of(name: str, text: str | bytes) -> Callable[[Path], Any]:
    """A file of a text, in which SECRET is a file beside the folder."""

    def make(folder: Path) -> None:
        (folder.parent / "secret.txt").write_text("secret")
        data = text.encode() if isinstance(text, str) else text
        (folder / name).write_bytes(
            data.replace(b"SECRET", str((folder.parent / "secret.txt").resolve()).encode())
        )

    return make


def both(*makes: Callable[[Path], Any]) -> Callable[[Path], None]:
    """All of these files."""

    def make(folder: Path) -> None:
        for each in makes:
            each(folder)

    return make


BOUNDARY = ("field", "import", "b.kml", "--dem", "d.tif", "--header-width-m", "9", "--out", "out")


def kml(head: str, times: int = 1) -> Callable[[Path], None]:
    """A boundary with a head."""
    return both(_field_and_dem, file_of("b.kml", _with_entities(KML, head, times)))


# ---- models


def fmu(text: str, **members: bytes) -> Callable[[Path], None]:
    """An FMU with a description."""

    def make(folder: Path) -> None:
        with zipfile.ZipFile(folder / "model.fmu", "w", zipfile.ZIP_DEFLATED) as made:
            made.writestr("modelDescription.xml", text)
            for name, data in members.items():
                made.writestr(name, data)

    return make


def _described(head: str = "", change: Callable[[str], str] = lambda text: text) -> str:
    from tests.link.made_fmus import process_xml

    text = change(process_xml())
    first, _, rest = text.partition("?>")
    return f"{first}?>{head}{rest}".replace('modelName="', 'modelName="&a11;' if head else 'modelName="', 1)


def lazily(make: Callable[[], Callable[[Path], Any]]) -> Callable[[Path], Any]:
    """What is made when it is asked for."""
    return lambda folder: make()(folder)


def _slips(folder: Path) -> None:
    names = {f"../{ACTED}": b"x", f"binaries/../../{ACTED}": b"x", f"/{folder.resolve()}/{ACTED}": b"x",
             f"..\\{ACTED}": b"x", f"resources/{'../' * 30}tmp/{ACTED}": b"x"}  # fmt: skip
    fmu(_described(), **names)(folder)


def _link_in_archive(folder: Path) -> None:
    """A member that is a link out, and one through it."""
    with zipfile.ZipFile(folder / "model.fmu", "w") as made:
        made.writestr("modelDescription.xml", _described())
        link = zipfile.ZipInfo("resources")
        link.external_attr = 0o120777 << 16
        made.writestr(link, str(folder.resolve()))
        made.writestr(f"resources/{ACTED}", "x")


def _hidden_member(folder: Path) -> None:
    """A member of 2 GB that says in the directory that it has 1 kB."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    body = b"".join(packer.compress(b" " * (1 << 20)) for _ in range(2048)) + packer.flush()
    name = b"modelDescription.xml"
    about = struct.pack("<HHHHHIIIHH", 20, 0, 8, 0, 33, 0, len(body), 1000, len(name), 0)
    local = b"PK\3\4" + about + name + body
    head = (
        struct.pack("<HHHHHHIIIHHHHHII", 20, 20, 0, 8, 0, 33, 0, len(body), 1000, len(name), 0, 0, 0, 0, 0, 0)
        + name
    )
    end = b"PK\5\6" + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(head) + 4, len(local), 0)
    (folder / "model.fmu").write_bytes(local + b"PK\1\2" + head + end)


def _many_members(folder: Path) -> None:
    with zipfile.ZipFile(folder / "model.fmu", "w") as made:
        made.writestr("modelDescription.xml", _described())
        for k in range(120_000):
            made.writestr(zipfile.ZipInfo(f"resources/{k}"), b"")


def ssp(text: str, name: str = "SystemStructure.ssd") -> Callable[[Path], None]:
    """A system of models with a description."""

    def make(folder: Path) -> None:
        with zipfile.ZipFile(folder / "model.ssp", "w") as made:
            made.writestr(name, text)

    return make


def _system(inside: str, head: str = "") -> str:
    space = 'xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"'
    return (f'<?xml version="1.0"?>{head}<ssd:SystemStructureDescription {space} version="1.0" name="a">'
            f'<ssd:System name="s">{inside}</ssd:System></ssd:SystemStructureDescription>')  # fmt: skip


def _component(source: str) -> str:
    return f'<ssd:Elements><ssd:Component name="c" type="application/x-fmu-sharedlibrary" source="{source}"/></ssd:Elements>'


SHOW, SHOW_SSP = ("fmu", "show", "model.fmu"), ("fmu", "show", "model.ssp")

# ---- scenarios


def scenario(more: str = "", field: str = "") -> Callable[[Path], Any]:
    """A scenario with more in its machine, or its field."""
    text = SCENARIO.replace("MORE", more).replace("WEATHER", field)
    return lambda folder: (folder / "mine.yaml").write_text(text)


def body(name: str, text: str | bytes, **others: str | bytes) -> Callable[[Path], None]:
    """A machine whose body is a file; with other files beside it."""
    made = [file_of(name, text), *(file_of(other, data) for other, data in others.items())]
    return both(scenario(f", body: {{file: {name}}}"), *made)


BOX = '{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],'


def gltf(uri: str, length: int = 72, nodes: str = '[{"mesh":0}]', image: str = "") -> str:
    """A mesh whose corners lie elsewhere."""
    rest = (f'"buffers":[{{"byteLength":{length},"uri":"{uri}"}}],"bufferViews":[{{"buffer":0,"byteLength":{length}}}],'
            f'"accessors":[{{"bufferView":0,"componentType":5126,"count":{length // 12},"type":"VEC3"}}]{image}}}')  # fmt: skip
    return BOX.replace('[{"mesh":0}]', nodes) + rest


def _deep_nodes() -> str:
    nodes = ",".join(f'{{"children":[{k + 1}]}}' for k in range(20_000)) + ',{"mesh":0}'
    return gltf("data:application/octet-stream;base64," + "A" * 96, nodes=f"[{nodes}]")


PLY = "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n"
OBJ = "mtllib {}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl a\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"

# ---- rasters

PIXELS = f"""<VRTDataset rasterXSize="80" rasterYSize="120"><SRS>EPSG:32632</SRS>
<GeoTransform>499700.0, 10.0, 0.0, 5762100.0, 0.0, -10.0</GeoTransform>
<VRTRasterBand dataType="Float32" band="1" subClass="VRTDerivedRasterBand"><PixelFunctionType>act</PixelFunctionType>
<PixelFunctionLanguage>Python</PixelFunctionLanguage><PixelFunctionCode><![CDATA[
def act(in_ar, out_ar, xoff, yoff, xsize, ysize, raster_xsize, raster_ysize, buf_radius, gt, **kwargs):
    {WRITE}
    out_ar[:] = 100
]]></PixelFunctionCode><SimpleSource><SourceFilename relativeToVRT="0">SOURCE</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>"""


def beside_raster(name: str, text: str) -> Callable[[Path], None]:
    """A height model with another file beside it."""
    return both(_field_and_dem, file_of(name, text.replace("SOURCE", "d.tif")))


def _large_raster(kind: str, size: int) -> Callable[[Path], None]:
    """A raster of one value that says that it has size x size."""

    def make(folder: Path) -> None:
        import rasterio
        from rasterio.transform import from_origin

        _field_and_dem(folder)
        with rasterio.open(
            folder / "d.tif", "w", driver="GTiff", width=size, height=size, count=1, dtype=kind, crs="EPSG:32632",
            transform=from_origin(499_700.0, 5_762_100.0, 10.0 * 100 / size, 10.0 * 100 / size), tiled=True,
            blockxsize=4096, blockysize=4096, compress="deflate", sparse_ok=True, BIGTIFF="YES",
        ):  # fmt: skip
            pass

    return make


def _endless_directories(folder: Path) -> None:
    """The directory of a TIFF is followed by itself."""
    _field_and_dem(folder)
    data = bytearray((folder / "d.tif").read_bytes())
    at = struct.unpack_from("<I", data, 4)[0]
    count = struct.unpack_from("<H", data, at)[0]
    struct.pack_into("<I", data, at + 2 + 12 * count, at)
    (folder / "d.tif").write_bytes(data)


def _path_of_gdal(path: str) -> Callable[[Path], Any]:
    return scenario("", f", maps: {{file: '{path}'}}")


def _named(path: str) -> Attack:
    command = ("field", "import", "b.kml", "--dem", path, "--header-width-m", "9", "--out", "out")
    return Attack(_field_and_dem, command, "connect, or read elsewhere: a path of GDAL's own")


# ---- shapefiles, task data, GeoJSON


def shapes(**parts: bytes) -> Callable[[Path], None]:
    """A shapefile in an archive with further or other parts."""

    def make(folder: Path) -> None:
        from tests.fuzz.kinds import KINDS

        KINDS["log-shapefile"].make(folder)
        with zipfile.ZipFile(folder / "log.zip") as old:
            found = {name: old.read(name) for name in old.namelist()}
        found |= {f"a.{name}": data for name, data in parts.items()}
        with zipfile.ZipFile(folder / "log.zip", "w", zipfile.ZIP_DEFLATED) as made:
            for name, data in found.items():
                made.writestr(name, data)

    return make


SHAPES = ("field", "import", "log.zip", "--as", "map", "--header-width-m", "6", "--out", "out")


def task(xml: str, zipped: bool = False) -> Callable[[Path], None]:
    """Task data of a text."""

    def make(folder: Path) -> None:
        text = xml.replace("SECRET", str(folder.resolve()))
        if zipped:
            with zipfile.ZipFile(folder / "log.zip", "w", zipfile.ZIP_DEFLATED) as made:
                made.writestr("TASKDATA/TASKDATA.XML", text)
            return
        (folder / "log").mkdir()
        (folder / "log" / "TASKDATA.XML").write_text(text)

    return make


TASK = ("field", "import", "log", "--out", "out")
LOGGED = '<?xml version="1.0"?>{}<ISO11783_TaskData VersionMajor="4" VersionMinor="0" DataTransferOrigin="1">{}</ISO11783_TaskData>'
TIME_LOG = '<TSK A="TSK1" G="4"><TLG A="{}" C="1"/></TSK>'


def geojson(coordinates: str) -> Callable[[Path], None]:
    """A boundary of this."""
    text = f'{{"type":"FeatureCollection","features":[{{"type":"Feature","properties":{{}},"geometry":{{"type":"Polygon","coordinates":{coordinates}}}}}]}}'
    return both(_field_and_dem, lambda folder: (folder / "b.geojson").write_text(text))


GEOJSON = ("field", "import", "b.geojson", "--dem", "d.tif", "--header-width-m", "9", "--out", "out")
CORNERS = [[float(v) for v in point.split(",")[:2]] for point in RING.split()]


def _many_corners() -> str:
    at = np.linspace(0.0, 2.0 * np.pi, 400_001)
    reach = 0.002 * (1.0 + 0.5 * np.sin(40_000 * at))
    return json.dumps(
        [[[9.0 + r * c, 52.0 + r * s] for r, c, s in zip(reach, np.cos(at), np.sin(at), strict=True)]]
    )


def _own_field(boundary: str) -> Callable[[Path], None]:
    """A field of AgOpenGPS with a boundary."""

    def make(folder: Path) -> None:
        from tests.field.test_agopengps import as_agopengps_writes

        as_agopengps_writes(folder / "log")
        (folder / "log" / "Boundary.txt").write_text(boundary)

    return make


def _aliases(levels: int) -> str:
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    return (
        "\n".join([*lines, *(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, levels))])
        + "\n"
    )


def _photo_bomb(folder: Path) -> None:
    """A picture of 60,000 x 60,000 within a mesh."""
    out = io.BytesIO()
    head = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    packer = zlib.compressobj(9)
    body = b"".join(packer.compress(bytes(60_000 * 3 + 1)) for _ in range(20_000)) + packer.flush()
    out.write(b"\x89PNG\r\n\x1a\n")
    for name, data in ((b"IHDR", head), (b"IDAT", body), (b"IEND", b"")):
        out.write(struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)))
    image = ',"images":[{"uri":"p.png"}],"textures":[{"source":0}],"materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}]'
    mesh = gltf("data:application/octet-stream;base64," + "A" * 96, image=image).replace(
        '{"POSITION":0}', '{"POSITION":0},"material":0'
    )
    body_ = scenario(", body: {file: m.gltf}")
    body_(folder)
    (folder / "m.gltf").write_text(mesh)
    (folder / "p.png").write_bytes(out.getvalue())


DOCUMENTS: dict[str, Attack] = {
    "kml-laughs": Attack(kml(BOMB), BOUNDARY, "memory: entities of entities", is_quick=True),
    "kml-square": Attack(kml(SQUARE, 20_000), BOUNDARY, "memory: a long entity 20,000 times"),
    "kml-outside": Attack(kml(OUTSIDE), BOUNDARY, "read a file elsewhere, connect"),
    "kml-doctype": Attack(kml(ELSEWHERE), BOUNDARY, "connect: a definition elsewhere"),
    "kml-deep": Attack(
        both(_field_and_dem, file_of("b.kml", "<kml>" + "<Folder>" * 1_000_000)),
        BOUNDARY,
        "end the process: a million elements deep",
    ),
    "fmu-laughs": Attack(
        lazily(lambda: fmu(_described(BOMB))), SHOW, "memory: entities of entities", is_quick=True
    ),
    "fmu-outside": Attack(lazily(lambda: fmu(_described(OUTSIDE))), SHOW, "read a file elsewhere, connect"),
    "fmu-deep": Attack(
        lazily(lambda: fmu("<fmiModelDescription fmiVersion='2.0'>" + "<a>" * 1_000_000)),
        SHOW,
        "end the process: a million elements deep",
    ),
    "fmu-attributes": Attack(
        lazily(
            lambda: fmu(
                _described(
                    "",
                    lambda text: text.replace(
                        "<ModelVariables>",
                        "<ModelVariables>"
                        + "".join(
                            f'<ScalarVariable name="v{k}" valueReference="{k + 100}"><Real/></ScalarVariable>'
                            for k in range(200_000)
                        ),
                    ),
                )
            )
        ),
        SHOW,
        "time: 200,000 variables",
    ),
    "fmu-slips": Attack(_slips, SHOW, "write elsewhere: members above the archive", is_quick=True),
    "fmu-link": Attack(_link_in_archive, SHOW, "write elsewhere: a member through a link"),
    "fmu-hidden": Attack(_hidden_member, SHOW, "memory: 2 GB that say 1 kB"),
    "fmu-members": Attack(_many_members, SHOW, "time: 120,000 members"),
    "fmu-checked": Attack(
        lazily(lambda: fmu(_described(), **{"binaries/linux64/store.so": b"\x7fELF" + bytes(60)})),
        ("fmu", "check", "model.fmu"),
        f"{CODE_RUNS}: a library without --allow-code",
    ),
    "ssp-laughs": Attack(
        ssp(_system("&a11;", BOMB)), SHOW_SSP, "memory: entities of entities", is_quick=True
    ),
    "ssp-outside": Attack(ssp(_system("&a11;", OUTSIDE)), SHOW_SSP, "read a file elsewhere, connect"),
    "ssp-web": Attack(ssp(_system(_component(WEB))), SHOW_SSP, "connect: a model elsewhere"),
    "ssp-above": Attack(
        ssp(_system(_component("../../../../../../etc/passwd"))), SHOW_SSP, "read a file elsewhere"
    ),
    "ssp-deep": Attack(
        ssp(_system("<ssd:Elements><ssd:System name='s'>" * 50_000)),
        SHOW_SSP,
        "end the process: systems 50,000 deep",
    ),
    "urdf-laughs": Attack(
        body("m.urdf", _with_entities(URDF, BOMB)), DRIVE, "memory: entities of entities", RAN, True
    ),
    "urdf-mesh": Attack(
        body("m.urdf", URDF.replace("cube.stl", WEB)), DRIVE, "connect: a mesh elsewhere", RAN
    ),
    "urdf-package": Attack(
        body("m.urdf", URDF.replace("cube.stl", f"package://../{SECRET}")),
        DRIVE,
        "read a file elsewhere",
        RAN,
    ),
    "urdf-cycle": Attack(
        body("m.urdf", URDF.replace('<parent link="base"/>', '<parent link="header"/>')),
        DRIVE,
        "never end: a link of itself",
        RAN,
        True,
    ),
    "urdf-cylinder": Attack(
        body("m.urdf", URDF.replace('<box size="6 3 3"/>', '<sphere radius="1e308"/>')),
        DRIVE,
        "end badly: an endless ball",
        RAN,
    ),
    "sdf-include": Attack(
        body("m.sdf", SDF.replace("<frame ", f"<include><uri>{WEB}</uri></include><frame ")),
        DRIVE,
        "connect: a model elsewhere",
        RAN,
    ),
    "sdf-frames": Attack(
        body(
            "m.sdf",
            SDF.replace(
                '<frame name="f"><pose degrees="true">',
                '<frame name="f" attached_to="f"><pose relative_to="f">',
            ),
        ),
        DRIVE,
        "never end: a frame of itself",
        RAN,
    ),
    "gltf-web": Attack(body("m.gltf", gltf(WEB)), DRIVE, "connect: corners elsewhere", RAN),
    "gltf-above": Attack(body("m.gltf", gltf("../secret.txt", 12)), DRIVE, "read a file elsewhere", RAN),
    "gltf-zero": Attack(
        body("m.gltf", gltf("/dev/zero")), DRIVE, "never end: corners of /dev/zero", RAN, True
    ),
    "gltf-cycle": Attack(
        body(
            "m.gltf",
            gltf("data:application/octet-stream;base64," + "A" * 96, nodes='[{"mesh":0,"children":[0]}]'),
        ),
        DRIVE,
        "never end: a part within itself",
        RAN,
    ),
    "gltf-deep": Attack(
        lazily(lambda: body("m.gltf", _deep_nodes())), DRIVE, "end badly: parts 20,000 deep", RAN
    ),
    "gltf-picture": Attack(_photo_bomb, DRIVE, "memory: a picture of 10 GB", RAN),
    "obj-web": Attack(body("m.obj", OBJ.format(WEB)), DRIVE, "connect: materials elsewhere", RAN),
    "obj-above": Attack(
        body("m.obj", OBJ.format("/dev/zero")), DRIVE, "never end: materials of /dev/zero", RAN
    ),
    "obj-faces": Attack(
        body("m.obj", OBJ.format("m.mtl") + "f " + "1 2 3 " * 2_000_000 + "\n"),
        DRIVE,
        "time: a face of 6 million corners",
        RAN,
    ),
    "ply-count": Attack(body("m.ply", PLY.format(10**12, 1)), DRIVE, "memory: 1e12 corners", RAN, True),
    "ply-faces": Attack(
        body("m.ply", PLY.format(4, 2_000_000_000).encode() + bytes(48) + b"\xff" * 2000),
        DRIVE,
        "memory: 2e9 faces of 255 corners",
        RAN,
    ),
    "ply-properties": Attack(
        body(
            "m.ply",
            PLY.replace(
                "property float x\n",
                "property float x\n" + "".join(f"property float a{k}\n" for k in range(100_000)),
            ).format(4, 1),
        ),
        DRIVE,
        "time: 100,000 properties",
        RAN,
    ),
    "stl-count": Attack(
        body("m.stl", bytes(80) + struct.pack("<I", 0xFFFFFFFF) + bytes(50)), DRIVE, "memory: 4e9 faces", RAN
    ),
    "off-count": Attack(
        body("m.off", "OFF\n99999999999 99999999999 0\n0 0 0\n"), DRIVE, "memory: 1e11 corners", RAN
    ),
    "tif-pixels": Attack(
        both(_field_and_dem, file_of("d.tif", PIXELS.replace("SOURCE", "e.tif"))),
        BOUNDARY,
        f"{CODE_RUNS}: a raster that names Python",
    ),
    "tif-overview": Attack(
        beside_raster("d.tif.ovr", PIXELS), BOUNDARY, f"{CODE_RUNS}: an overview beside a raster"
    ),
    "tif-mask": Attack(beside_raster("d.tif.msk", PIXELS), BOUNDARY, f"{CODE_RUNS}: a mask beside a raster"),
    "tif-pam": Attack(
        beside_raster(
            "d.tif.aux.xml", f'{BOMB}<PAMDataset><Metadata><MDI key="a">&a11;</MDI></Metadata></PAMDataset>'
        ),
        BOUNDARY,
        "memory: entities beside a raster",
    ),
    "tif-pam-outside": Attack(
        beside_raster(
            "d.tif.aux.xml",
            f'<PAMDataset><Metadata domain="OVERVIEWS"><MDI key="OVERVIEW_FILE">/vsicurl/{WEB}</MDI></Metadata></PAMDataset>',
        ),
        BOUNDARY,
        "connect: an overview elsewhere",
    ),
    "tif-large": Attack(_large_raster("float64", 100_000), BOUNDARY, "memory: 80 GB in 1 MB"),
    "tif-loop": Attack(_endless_directories, BOUNDARY, "never end: directories of a TIFF", is_quick=True),
    "tif-web": _named(f"/vsicurl/{WEB}.tif"),
    "tif-url": _named(f"{WEB}.tif"),
    "tif-zip": _named("/vsizip/vsicurl/" + WEB),
    "tif-text": _named(PIXELS.replace("SOURCE", "d.tif").replace("\n", " ")),
    "shp-codec": Attack(
        shapes(cpg=b"zlib_codec"), SHAPES, "end badly: a codec that is none of text", is_quick=True
    ),
    "shp-codecs": Attack(
        shapes(cpg=b"../../../tmp/evil"), SHAPES, f"{CODE_RUNS}: a codec that is looked for as a module"
    ),
    "shp-escape": Attack(shapes(cpg=b"unicode_escape"), SHAPES, "end badly: a codec that changes text"),
    "shp-count": Attack(
        shapes(dbf=b"\x03\x7f\x01\x01" + struct.pack("<IHH", 0xFFFFFFFF, 65, 1) + bytes(20) + b"\r"),
        SHAPES,
        "memory: 4e9 records of one byte",
    ),
    "shp-head": Attack(
        shapes(dbf=b"\x03\x7f\x01\x01" + struct.pack("<IHH", 1, 0xFFFF, 0xFFFF) + bytes(20)),
        SHAPES,
        "read beyond: a head of 65,535 bytes",
    ),
    "shp-projection": Attack(shapes(prj=b"PROJCS[" * 200_000), SHAPES, "end the process: 200,000 brackets"),
    "shp-grid": Attack(
        shapes(prj=b"+proj=longlat +nadgrids=@/vsicurl/" + WEB.encode() + b",/dev/zero"),
        SHAPES,
        "connect: a grid of a projection",
    ),
    "task-laughs": Attack(
        task(LOGGED.format(BOMB, "&a11;")), TASK, "memory: entities of entities", is_quick=True
    ),
    "task-outside": Attack(task(LOGGED.format(OUTSIDE, "&a11;")), TASK, "read a file elsewhere, connect"),
    "task-part": Attack(
        task(LOGGED.format("", f'<XFR A="../../{SECRET}" B="1"/>' + TIME_LOG.format("../../../etc/passwd"))),
        TASK,
        "read a file elsewhere: parts",
    ),
    "task-itself": Attack(
        task(LOGGED.format("", '<XFR A="TASKDATA" B="1"/>' * 50)), TASK, "never end: a part of itself"
    ),
    "task-deep": Attack(
        task(LOGGED.format("", "<TZN A='1'>" * 1_000_000)), TASK, "end the process: a million elements deep"
    ),
    "task-zip": Attack(
        lambda folder: task(LOGGED.format("", " " * (700 << 20)), zipped=True)(folder),
        ("field", "import", "log.zip", "--out", "out"),
        "memory: 700 MB in 700 kB",
    ),
    "task-link": Attack(
        lambda folder: ((folder / "log").mkdir(), os.symlink("/dev/zero", folder / "log" / "TASKDATA.XML")),
        TASK,
        "never end: a link to /dev/zero",
        is_quick=True,
    ),
    "task-pipe": Attack(
        lambda folder: ((folder / "log").mkdir(), os.mkfifo(folder / "log" / "TASKDATA.XML")),
        TASK,
        "wait for ever: a pipe",
        is_quick=True,
    ),
    "geojson-deep": Attack(
        geojson("[" * 200_000), GEOJSON, "end the process: brackets 200,000 deep", is_quick=True
    ),
    "geojson-digits": Attack(
        geojson(f"[[[{'9' * 3_000_000},1],[1,1]]]"), GEOJSON, "time: a number of 3 million digits"
    ),
    "geojson-numbers": Attack(
        geojson("[[[NaN,1e999],[Infinity,-Infinity],[1,1],[NaN,1e999]]]"),
        GEOJSON,
        "end badly: numbers that are none",
    ),
    "geojson-corners": Attack(
        lazily(lambda: geojson(_many_corners())), GEOJSON, "time: 400,000 corners that cross"
    ),
    "geojson-reach": Attack(
        geojson(
            json.dumps([[[-179.0, -80.0], [179.0, -80.0], [179.0, 84.0], [-179.0, 84.0], [-179.0, -80.0]]])
        ),
        GEOJSON,
        "memory: a field as large as the Earth",
    ),
    "yaml-python": Attack(
        file_of("mine.yaml", f"!!python/object/apply:eval ['{WRITE}']\n"),
        DRIVE,
        f"{CODE_RUNS}: a tag",
        RAN,
        True,
    ),
    "yaml-tag": Attack(
        file_of(
            "mine.yaml",
            SCENARIO.replace("MORE", "").replace("WEATHER", "")
            + f"more: !!python/name:os.system\nx: !!python/object/new:eval [['{WRITE}']]\n",
        ),
        DRIVE,
        f"{CODE_RUNS}: a tag inside",
        RAN,
    ),
    "yaml-aliases": Attack(
        file_of("mine.yaml", _aliases(12)), DRIVE, "memory: aliases of aliases", RAN, True
    ),
    "yaml-merges": Attack(
        file_of(
            "mine.yaml",
            "a0: &a0 {b: 1}\n"
            + "".join(f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 10)}]}}\n" for k in range(1, 12)),
        ),
        DRIVE,
        "time: merges of merges",
        RAN,
    ),
    "yaml-deep": Attack(
        file_of("mine.yaml", "[" * 200_000), DRIVE, "end the process: brackets 200,000 deep", RAN
    ),
    "yaml-digits": Attack(
        file_of("mine.yaml", "a: " + "9" * 3_000_000 + "\nb: 1:" + "59:" * 300_000 + "1\n"),
        DRIVE,
        "time: a number of 3 million digits",
        RAN,
    ),
    "yaml-keys": Attack(
        file_of("mine.yaml", "".join(f"k{k}: 1\n" for k in range(400_000))), DRIVE, "time: 400,000 keys", RAN
    ),
    "yaml-endless": Attack(
        lambda folder: sparse(folder / "mine.yaml", b"name: a", 4 * GIB), DRIVE, "memory: 4 GB of zeros", RAN
    ),
    "agopengps-count": Attack(
        _own_field("$Boundary\nFalse\n4000000000\n0,0,0\n"),
        ("field", "import", "log", "--header-width-m", "9", "--out", "out"),
        "memory: 4e9 points",
        is_quick=True,
    ),
    "agopengps-digits": Attack(
        _own_field(f"$Boundary\nFalse\n{'9' * 1_000_000}\n0,0,0\n"),
        ("field", "import", "log", "--header-width-m", "9", "--out", "out"),
        "time: a count of a million digits",
    ),
}
