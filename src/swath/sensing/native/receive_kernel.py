"""The receiver and the places of its echoes as Warp kernels: receive.cpp, place_echoes.cpp."""

from pathlib import Path

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
_HERE = Path(__file__).parent


@wp.func_native((_HERE / "receive.cpp").read_text(encoding="utf-8"))
def receive_beams(whole: wp.array(dtype=wp.int64), real: wp.array(dtype=wp.float64)): ...


@wp.kernel
def receive(whole: wp.array(dtype=wp.int64), real: wp.array(dtype=wp.float64)):
    """One thread for all beams; see receive.cpp."""
    receive_beams(whole, real)


@wp.func_native((_HERE / "place_echoes.cpp").read_text(encoding="utf-8"))
def place_all(whole: wp.array(dtype=wp.int64)): ...


@wp.kernel
def place_echoes(whole: wp.array(dtype=wp.int64)):
    """One thread for all echoes; see place_echoes.cpp."""
    place_all(whole)
