"""Embree at its best: not `robust`, high build quality, cast from C++ in packets of several widths.

python benchmarks/embree.py

casts at one triangle and says how; `benchmarks/rays.py` holds packets of rays against it. Needs embreex, of
the development tools, and for more than its own loop g++ or clang++ with the headers of the C++ library.
`embree.cpp` is compiled against the library of embreex when there is a C++ compiler. Without one embreex
itself serves, which casts ray by ray from its own loop and builds with medium quality: `Embree.how` says
which it was.
"""

import ctypes
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

FLAGS = ("-O3", "-march=native", "-std=c++17", "-shared", "-fPIC")
WIDTHS = (1, 4, 8, 16)
HIGH = 2


class Embree:
    """Triangles (f, 3) over vertices (n, 3). quality: 0 low, 1 medium, 2 high.

    widths: of the packets that can be cast; how: flags and quality, for tables
    """

    def __init__(
        self, vertices: np.ndarray, faces: np.ndarray, *, quality: int = HIGH, robust: bool = False
    ) -> None:
        self._vertices = np.zeros((len(vertices) + 1, 3), np.float32)  # Embree reads four bytes further
        self._vertices[:-1] = vertices
        self._faces = np.ascontiguousarray(faces, np.uint32)
        self._library = compiled()
        name = ("low", "medium", "high")[quality]
        if self._library is None:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene

            self._scene: Any = EmbreeScene(robust=robust)
            TriangleMesh(self._scene, self._vertices[:-1], self._faces.astype(np.int32))
            self.widths: tuple[int, ...] = (1,)
            self.how = f"embreex, {'robust' if robust else 'not robust'}, no compiler for more"
            return
        self._scene = self._library.build(
            self._vertices.ctypes.data, len(vertices), self._faces.ctypes.data, len(faces), quality, robust
        )
        self.widths = WIDTHS
        self.how = f"{'robust' if robust else 'not robust'}, {name} build quality, g++ {' '.join(FLAGS[:3])}"

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        range_max: float,
        width: int,
        *,
        coherent: bool = False,
    ) -> np.ndarray:
        """Distances (n,) of rays (n, 3) of float32 [m]; range_max where nothing is hit."""
        if self._library is None:
            return np.asarray(self._scene.run(origins, directions, query="DISTANCE"))
        out = np.empty(len(origins), np.float32)
        self._library.intersect(
            self._scene, origins.ctypes.data, directions.ctypes.data, len(origins), range_max, width,
            coherent, out.ctypes.data,
        )  # fmt: skip
        return out

    def release(self) -> None:
        """Give its memory back."""
        if self._library is not None:
            self._library.release(self._scene)
        self._scene = None


@cache
def compiled() -> Any:
    """The functions of embree.cpp, None where there is no compiler or no embreex."""
    import embreex

    folder = Path(embreex.__file__).parents[1] / "embreex.libs"
    found = sorted(folder.glob("libembree4*.so*"))
    compiler = shutil.which("g++") or shutil.which("clang++")
    if not found or compiler is None:
        return None
    out = Path(tempfile.mkdtemp()) / "embree.so"
    source = Path(__file__).with_name("embree.cpp")
    command = [compiler, *FLAGS, str(source), str(found[0]), f"-Wl,-rpath,{folder}", "-o", str(out)]
    # libtbb is found beside it when the program runs
    command.insert(-2, "-Wl,--unresolved-symbols=ignore-in-shared-libs")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        print(f"embree.cpp does not compile: {done.stderr.strip()[-400:]}", file=sys.stderr)
        return None
    for tbb in sorted(folder.glob("libtbb*.so*")):
        ctypes.CDLL(str(tbb), mode=ctypes.RTLD_GLOBAL)
    library = ctypes.CDLL(str(out))
    library.build.restype = ctypes.c_void_p
    library.build.argtypes = [
        ctypes.c_void_p,
        ctypes.c_size_t,
        ctypes.c_void_p,
        ctypes.c_size_t,
        ctypes.c_int,
        ctypes.c_int,
    ]
    library.release.argtypes = [ctypes.c_void_p]
    library.intersect.argtypes = [
        *[ctypes.c_void_p] * 3, ctypes.c_size_t, ctypes.c_float, ctypes.c_int, ctypes.c_int, ctypes.c_void_p,
    ]  # fmt: skip
    return library


def main() -> None:
    """One triangle 2 m ahead, two of four rays at it."""
    corners = np.array([[2.0, -1.0, -1.0], [2.0, 1.0, -1.0], [2.0, 0.0, 1.0]], np.float32)
    directions = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.1], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], np.float32)
    scene = Embree(corners, np.array([[0, 1, 2]]))
    for width in scene.widths:
        far = scene.cast(np.zeros((4, 3), np.float32), directions, 10.0, width)
        print(f"{width:2d} rays together: {np.round(far, 3).tolist()} m")
    print(scene.how)
    scene.release()


if __name__ == "__main__":
    main()
