"""Warp, started quietly and with a kernel cache that this user may write to; small kernels for one step."""

import ctypes
import os
import stat
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache, partial, wraps
from pathlib import Path
from struct import Struct
from typing import Any

import numpy as np

from swath.core.files.temporary import TemporaryFolder
from swath.core.rows import address as address

# Kernels are compiled for this processor, or for the one that SWATH_CPU names as Clang does (`haswell` has
# AVX2 and no AVX-512): the results are the same.
BUILT_FOR = f"-target-cpu {os.environ['SWATH_CPU']}" if "SWATH_CPU" in os.environ else "-march=native"
# Of all kernels: Warp's headers are compiled anew for each other set of flags. Warp asks LLVM to inline nine
# times as much, which takes longer to compile and is no faster here.
FLAGS = f"{BUILT_FOR} -mllvm=-inline-threshold=1000"


_loading = threading.RLock()  # held by the thread that starts Warp, or loads kernels


def _loading_anew() -> None:
    """In a process that was forked, whose parent may have held it."""
    global _loading
    _loading = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_loading_anew)


@cache
def start_warp() -> Any:
    """The `warp` module, initialised, also where threads ask for it at once."""
    with _loading:
        return _started()


@cache
def _started() -> Any:
    """Start Warp.

    The kernel cache is Warp's own (WARP_CACHE_PATH or the user's cache folder); when that cannot be written,
    a folder of this user in the system's temporary folder.
    """
    import warp as wp

    if hasattr(wp.config, "log_level"):  # newer than 1.10
        wp.config.log_level = wp.LOG_ERROR
    else:
        wp.config.quiet = True
    wp.config.cpu_compiler_flags = FLAGS
    if "WARP_CACHE_PATH" not in os.environ and not _is_usable(_user_cache() / "warp"):
        wp.config.kernel_cache_dir = str(_own_temporary())
    with _quiet_stderr():  # without a GPU driver the native part says so there
        wp.init()
    modules = type(wp.get_module(__name__))
    modules.load = _one_at_a_time(modules.load)
    return wp


def _one_at_a_time(load: Callable[..., Any]) -> Callable[..., Any]:
    """Warp's way to load compiled kernels, by one thread at a time: two that load the same ones unload what
    the other runs.
    """

    @wraps(load)
    def loaded(*args: Any, **kwargs: Any) -> Any:
        with _loading:
            return load(*args, **kwargs)

    return loaded


def member_array(kind: Any, name: str, array: Any, device: str = "cpu") -> Any:
    """A numpy array as the Warp array that a struct type has under a name.

    On the CPU it is the same memory, elsewhere a copy. Whoever repeats a launch keeps the struct.
    """
    dtype = kind.vars[name].type.dtype
    return start_warp().array(array, dtype=dtype, device=device, copy=device != "cpu")


def filled(kind: Any, device: str = "cpu", /, **members: Any) -> Any:
    """A new struct of a type of Warp with these members; numpy arrays as `member_array` has them."""
    struct = kind()
    for name, value in members.items():
        is_array = isinstance(value, np.ndarray)
        setattr(struct, name, member_array(kind, name, value, device) if is_array else value)
    return struct


def filled_by(kind: Any, owner: Any) -> Any:
    """The same, of what an object has under their names; a member that it has not is empty."""
    return filled(kind, **{name: getattr(owner, name) for name in kind.vars if hasattr(owner, name)})


def exact_code(*files: Path) -> str:
    """The body of a native function, in files, that has `ExactSum` and `exact_length` of exact.cpp."""
    return "\n".join(f.read_text(encoding="utf-8") for f in (Path(__file__).parent / "exact.cpp", *files))


def once(body: str) -> str:
    """The body of a native function whose functions are compiled once, not where they are called.

    For what is called some times a second: each copy of a function takes its time to compile.
    """
    held = "#pragma clang attribute push(__attribute__((noinline)), apply_to=function)"
    return f"{held}\n{body}\n#pragma clang attribute pop\n"


def known(numbers: Mapping[str, Any]) -> str:
    """Numbers, one or several under a name, as native functions know them: lines before the body."""
    lines = []
    for name, value in numbers.items():
        several = value if isinstance(value, tuple) else (value,)
        if isinstance(several[0], int | float):
            kind, listed = "int" if isinstance(several[0], int) else "double", ", ".join(map(repr, several))
            is_one = len(several) == 1
            lines.append(
                f"constexpr {kind} {name} = {listed};"
                if is_one
                else f"constexpr {kind} {name}[] = {{{listed}}};"
            )
    return "\n".join(lines)


def constants(*values: float) -> tuple[Any, ...]:
    """Real numbers as kernels have them."""
    wp = start_warp()
    return tuple(wp.constant(wp.float64(value)) for value in values)


class Row:
    """One struct of real numbers in memory that Python and a kernel on the CPU share.

    struct: a struct or vector type of Warp; array: what the kernel takes; names: of the struct's numbers
        write: sets all numbers; read: gives all of them
    """

    def __init__(self, struct: Any) -> None:
        self.array = start_warp().zeros(1, dtype=struct, device="cpu")
        row = self.array.numpy()
        self.names: tuple[str, ...] = row.dtype.names or ()
        self._bytes = memoryview(row.view(np.uint8).reshape(-1))
        layout = Struct(f"{self._bytes.nbytes // 8}d")
        self.write: Callable[..., None] = partial(layout.pack_into, self._bytes, 0)
        self.read: Callable[[], tuple[float, ...]] = partial(layout.unpack_from, self._bytes)


class Rows:
    """A struct for each world, in memory that Python and a kernel on the CPU share.

    array: what the kernel takes; of: by member, first axis the world
    """

    def __init__(self, struct: Any, count: int, values: Sequence[Sequence[float]] = ()) -> None:
        self.array = start_warp().zeros(count, dtype=struct, device="cpu")
        table = self.array.numpy()
        self._bytes = table.view(np.uint8).reshape(count, -1)
        self.of: dict[str, Any] = {name: table[name] for name in table.dtype.names or ()}
        for world, row in enumerate(values):
            table[world] = tuple(row)

    def clear(self) -> None:
        """Zeros in every world."""
        self._bytes[:] = 0

    def save(self, world: int) -> Any:
        """The struct of one world, as bytes."""
        return np.array(self._bytes[world])

    def load(self, world: int, state: Any) -> None:
        """Take on a state that `save` gave."""
        self._bytes[world] = state


def of_worlds(struct: Any, structs: Sequence[Any]) -> Any:
    """Structs that hold arrays, one a world, as a kernel on the CPU takes them; keep the structs."""
    return start_warp().array(list(structs), dtype=struct, device="cpu")


def shared(array: Any, dtype: Any = Any) -> Any:
    """The same memory for a kernel on the CPU."""
    return start_warp().array(array, dtype=dtype, device="cpu", copy=False)


def launch(kernel: Any, struct: Any) -> None:
    """One thread of a kernel on the CPU."""
    start_warp().launch(kernel, dim=1, inputs=[struct], device="cpu")


def repeatable(kernel: Any, inputs: list[Any], *, threads: int = 1) -> "Repeated":
    """A launch on the CPU that can be repeated for under a microsecond: call its `launch`.

    inputs: arrays and structs of Warp; what is in arrays may change, they themselves stay.
    """
    return Repeated(start_warp().launch(kernel, dim=threads, inputs=inputs, device="cpu", record_cmd=True))


def launch_on(kernel: Any, numbers: Any) -> Callable[[], Any]:
    """A repeatable launch on the CPU of a kernel whose one input is an array of float64, shared with it."""
    wp = start_warp()
    return repeatable(kernel, [wp.array(numbers, dtype=wp.float64, device="cpu", copy=False)]).launch


def over_rows(threads: int, kernel: Any, *given: Any) -> "Repeated":
    """As `repeatable`. given: arrays of Python or of Warp, structs, numbers."""
    inputs = [shared(value) if isinstance(value, np.ndarray) else value for value in given]
    return repeatable(kernel, inputs, threads=threads)


Numbered = tuple[Any, Any, Callable[[], Any]]


def numbered(kernel: Any, wholes: int, reals: int) -> Numbered:
    """Integers and float64 numbers of a kernel that takes an array of each, and its launch."""
    wp = start_warp()
    whole, real = np.zeros(wholes, np.int64), np.zeros(reals)
    shared = [wp.array(a, device="cpu", copy=False) for a in (whole, real)]
    return whole, real, repeatable(kernel, shared).launch


class Repeated:
    """A recorded launch of Warp whose arguments are laid out once, not at every launch."""

    def __init__(self, recorded: Any) -> None:
        self._recorded = recorded
        self._prepare()

    def set_param_at_index(self, index: int, value: Any) -> None:
        """Another argument from now on."""
        self._recorded.set_param_at_index(index, value)
        self._prepare()

    def _prepare(self) -> None:
        """Set `launch` to the compiled function, or to Warp's own launch where Warp hides the function."""
        self.launch: Callable[[], Any] = self._recorded.launch
        self._blocks: tuple[Any, Any, Any] | None = None
        try:
            bounds, *given = self._recorded.params
            forward, is_plain = self._recorded.hooks.forward, self._recorded.block_dim <= 1
        except AttributeError:
            return
        if is_plain and all(isinstance(value, ctypes.Structure | ctypes._SimpleCData) for value in given):
            fields = [(f"a{i}", type(value)) for i, value in enumerate(given)]
            packed: Any = type("Arguments", (ctypes.Structure,), {"_fields_": fields})(*given)
            packed.owner = self._recorded  # the memory lives as long as who launches
            self.launch = partial(forward, ctypes.byref(bounds), ctypes.byref(packed))
            self._blocks = forward, bounds, packed

    def addresses(self) -> tuple[int, int, int] | None:
        """Addresses of the compiled function, its bounds and its arguments; None where Warp hides them.

        They hold as long as this object lives.
        """
        if self._blocks is None:
            return None
        forward, *given = self._blocks
        entry: Any = ctypes.cast(forward, ctypes.c_void_p).value
        return entry, *map(ctypes.addressof, given)


@contextmanager
def _quiet_stderr() -> Iterator[None]:
    try:
        kept = os.dup(2)
    except OSError:  # there is no stderr
        yield
        return
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _is_usable(folder: Path) -> bool:
    """Whether this user can write to a folder and nobody else can: what lies in it is run."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            inside = (each for depth in ("*", "*/*", "*/*/*") for each in folder.glob(depth))
            return all(map(_is_own, (folder.resolve(), *folder.resolve().parents, *inside)))
    except OSError:
        return False


def _is_own(folder: Path) -> bool:
    """Whether a folder or file is this user's or root's, no link, and others cannot change what it holds; in
    one as /tmp they can only add to it. A group of the user's own name counts as the user.
    """
    if not hasattr(os, "getuid"):
        return True
    import grp
    import pwd

    about, others = folder.lstat(), stat.S_IWOTH
    with suppress(KeyError):
        others |= 0 if pwd.getpwuid(os.getuid())[0] == grp.getgrgid(about.st_gid)[0] else stat.S_IWGRP
    is_free = about.st_mode & others and not about.st_mode & stat.S_ISVTX
    return about.st_uid in (0, os.getuid()) and not is_free


def _own_temporary() -> Path:
    """A folder in the system's temporary one that nobody else can write to."""
    folder = Path(tempfile.gettempdir()) / f"swath-warp-{os.getuid() if hasattr(os, 'getuid') else -1}"
    is_good = not os.path.islink(folder) and _is_usable(folder)
    return folder if is_good else _aside().path


@cache
def _aside() -> TemporaryFolder:
    return TemporaryFolder("warp")


def _user_cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path(os.path.expanduser("~"), ".cache"))
