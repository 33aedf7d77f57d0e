"""Takes from this process, for good, what reading a file does not need: writing, the network, processes.

Linux alone has what does it: Landlock (docs.kernel.org/userspace-api/landlock.html) names the folders that
may be read, seccomp (docs.kernel.org/userspace-api/seccomp_filter.html) refuses calls of the system.
Elsewhere files cannot grow, where the system knows limits.
"""

import ctypes
import errno
import os
import struct
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from contextlib import suppress

SYSTEM = (  # what libraries read of the system, beside themselves
    "/usr", "/lib", "/lib64", "/etc/ld.so.cache", "/etc/localtime", "/etc/ssl/openssl.cnf", "/proc/self",
    "/proc/cpuinfo", "/proc/meminfo", "/sys/devices/system/cpu", "/dev/null", "/dev/urandom",
)  # fmt: skip
CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446  # of Landlock, on every processor
READ_FILE, READ_DIR = 1 << 2, 1 << 3
RIGHTS = {1: (1 << 13) - 1, 2: 1 << 13, 3: 1 << 14, 5: 1 << 15}  # of files, by the version that brought them
TCP, SCOPES = 0b11, 0b11  # from versions 4 and 6 on: bind and connect; abstract sockets and signals
NO_NEW_PRIVS, SECCOMP, FILTER, TSYNC = 38, {0xC000003E: 317, 0xC00000B7: 277}, 1, 1
ARCH = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}  # linux/audit.h
X32 = 0x40000000
WRITING = 0o1 | 0o2 | 0o100 | 0o1000 | 0o20000000  # write, both, create, cut off, without a name (fcntl.h)
THREAD = 0x00010000  # CLONE_THREAD
# Numbers of calls on x86-64 and Arm64; None where a processor has none.
REFUSED = {
    "socket": (41, 198), "socketpair": (53, 199), "connect": (42, 203), "bind": (49, 200),
    "listen": (50, 201), "accept": (43, 202), "accept4": (288, 242), "sendto": (44, 206),
    "sendmsg": (46, 211), "sendmmsg": (307, 269), "execve": (59, 221), "execveat": (322, 281),
    "fork": (57, None), "vfork": (58, None), "ptrace": (101, 117), "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271), "kill": (62, 129), "tkill": (200, 130), "rt_sigqueueinfo": (129, 138),
    "pidfd_open": (434, 434), "pidfd_send_signal": (424, 424), "pidfd_getfd": (438, 438),
    "creat": (85, None), "truncate": (76, 45), "ftruncate": (77, 46), "fallocate": (285, 47),
    "mkdir": (83, None), "mkdirat": (258, 34), "mknod": (133, None), "mknodat": (259, 33),
    "rmdir": (84, None), "unlink": (87, None), "unlinkat": (263, 35), "rename": (82, None),
    "renameat": (264, 38), "renameat2": (316, 276), "link": (86, None), "linkat": (265, 37),
    "symlink": (88, None), "symlinkat": (266, 36), "chmod": (90, None), "fchmod": (91, 52),
    "fchmodat": (268, 53), "chown": (92, None), "fchown": (93, 55), "lchown": (94, None),
    "fchownat": (260, 54), "utime": (132, None), "utimes": (235, None), "utimensat": (280, 88),
    "futimesat": (261, None), "setxattr": (188, 5), "lsetxattr": (189, 6), "fsetxattr": (190, 7),
    "mount": (165, 40), "umount2": (166, 39), "pivot_root": (155, 41), "chroot": (161, 51),
    "unshare": (272, 97), "setns": (308, 268), "bpf": (321, 280), "perf_event_open": (298, 241),
    "io_uring_setup": (425, 425), "userfaultfd": (323, 282), "add_key": (248, 217),
    "request_key": (249, 218), "keyctl": (250, 219), "open_by_handle_at": (304, 265),
    "shmget": (29, 194), "msgget": (68, 186), "semget": (64, 190), "mq_open": (240, 180),
    "init_module": (175, 105), "finit_module": (313, 273), "kexec_load": (246, 104),
}  # fmt: skip
UNKNOWN = {"clone3": (435, 435), "openat2": (437, 437)}  # the C library then takes the calls before them
OPEN, OPENAT, CLONE, TGKILL, PRLIMIT = (2, None), (257, 56), (56, 220), (234, 131), (302, 261)


def confine(roots: Iterable[str], memory: int, layers: Iterable[str] = ("landlock", "seccomp")) -> list[str]:
    """Confine this process; what took effect of the layers.

    roots: files and folders that may be read, beside what Python and the system need
    memory: bytes that it may take
    """
    with suppress(ImportError):
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    machine = os.uname().machine if sys.platform == "linux" else ""
    made: list[str] = []
    if machine in ARCH and sys.maxsize > 2**32:
        with suppress(OSError, AttributeError):  # no C library by this name, or a system without it
            library = ctypes.CDLL(None, use_errno=True)
            _checked(library.prctl(NO_NEW_PRIVS, 1, 0, 0, 0))
            for name, take in (("landlock", _landlock), ("seccomp", _seccomp)):
                if name in layers and take(library, [*roots, *SYSTEM, *_of_python()], machine):
                    made.append(name)
    return made


def _of_python() -> set[str]:
    """Where installed modules lie; not the folder of a user's script."""
    own = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    installed = {path for path in sys.path if os.path.basename(path) in ("site-packages", "dist-packages")}
    return {own, sys.prefix, sys.base_prefix, sys.exec_prefix, *sysconfig.get_paths().values(), *installed}


def _landlock(library: ctypes.CDLL, readable: list[str], machine: str) -> bool:
    version = library.syscall(CREATE_RULESET, None, ctypes.c_size_t(0), ctypes.c_uint32(1))
    if version < 1:
        return False
    rights = 0
    for since, right in RIGHTS.items():
        rights |= right if since <= version else 0
    words = [rights, *([TCP] if version >= 4 else []), *([SCOPES] if version >= 6 else [])]
    attributes = struct.pack(f"<{len(words)}Q", *words)
    ruleset = library.syscall(
        CREATE_RULESET, attributes, ctypes.c_size_t(len(attributes)), ctypes.c_uint32(0)
    )
    if ruleset < 0:
        return False
    try:
        for path in readable:
            _allow(library, ruleset, path)
        return bool(library.syscall(RESTRICT_SELF, ruleset, ctypes.c_uint32(0)) == 0)
    finally:
        os.close(ruleset)


def _allow(library: ctypes.CDLL, ruleset: int, path: str) -> None:
    """Allow to read a file, or all in a folder; what is not there stays refused."""
    try:
        file = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        rights = READ_FILE | READ_DIR if os.path.isdir(path) else READ_FILE
        _checked(library.syscall(ADD_RULE, ruleset, 1, struct.pack("<Qi", rights, file), ctypes.c_uint32(0)))
    finally:
        os.close(file)


def _seccomp(library: ctypes.CDLL, readable: list[str], machine: str) -> bool:
    arch = ARCH[machine]
    lines = list(_filter(arch, list(ARCH).index(machine)))
    program = ctypes.create_string_buffer(b"".join(struct.pack("<HBBI", *line) for line in lines))
    about = ctypes.create_string_buffer(struct.pack("<HxxxxxxQ", len(lines), ctypes.addressof(program)))
    return bool(library.syscall(SECCOMP[arch], FILTER, TSYNC, about) == 0)


def _filter(arch: int, which: int) -> Iterator[tuple[int, int, int, int]]:
    """The filter as BPF: (code, jump if true, jump if false, number)."""
    load, equal, above, bits, leave = 0x20, 0x15, 0x35, 0x45, 0x06
    allowed, killed, refused = 0x7FFF0000, 0x80000000, 0x00050000
    number, first, each = 0, 16, 8  # places of the call and of its arguments, in linux/seccomp.h
    yield load, 0, 0, 4
    yield equal, 1, 0, arch
    yield leave, 0, 0, killed
    yield load, 0, 0, number
    yield above, 0, 1, X32
    yield leave, 0, 0, refused | errno.ENOSYS
    for calls, code in ((REFUSED, errno.EPERM), (UNKNOWN, errno.ENOSYS)):
        for numbers in calls.values():
            if (call := numbers[which]) is not None:
                yield equal, 0, 1, call
                yield leave, 0, 0, refused | code
    own = os.getpid()
    for numbers, at, test, value, code in (
        (OPEN, 1, bits, WRITING, errno.EACCES),
        (OPENAT, 2, bits, WRITING, errno.EACCES),
        (CLONE, 0, bits, THREAD, 0),
        (TGKILL, 0, equal, own, 0),
        (PRLIMIT, 0, equal, own, 0),
    ):
        if (call := numbers[which]) is not None:
            yield equal, 0, 5 if numbers is PRLIMIT else 4, call
            yield load, 0, 0, first + each * at
            if numbers is PRLIMIT:  # 0: this process
                yield equal, 2, 0, 0
            if code:  # refused where a bit is set
                yield test, 0, 1, value
                yield leave, 0, 0, refused | code
            else:  # refused unless
                yield test, 1, 0, value
                yield leave, 0, 0, refused | errno.EPERM
            yield load, 0, 0, number
    yield leave, 0, 0, allowed


def _checked(result: int) -> None:
    if result < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
