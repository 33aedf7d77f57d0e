"""Ids of gymnasium, `swath/SCENARIO`, for every bundled scenario: known as soon as swath and gymnasium are
both imported, whichever comes first. swath itself does not import gymnasium.
"""

import sys
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

REGISTRY = "gymnasium.envs.registration"


def offer() -> None:
    """Register the ids, now where gymnasium is imported, else when it is."""
    if REGISTRY in sys.modules:
        _register(sys.modules[REGISTRY])
    else:
        sys.meta_path.insert(0, _Watcher())


def _register(registration: Any) -> None:
    from pathlib import Path

    for file in sorted((Path(__file__).parent / "data" / "scenarios").glob("*.yaml")):
        name = f"swath/{file.stem}"
        if name not in registration.registry:
            kwargs = {"scenario": file.stem}
            registration.register(
                id=name,
                entry_point="swath.environment:Env",
                vector_entry_point="swath.vector_environment:VectorEnv",
                kwargs=kwargs,
            )


class _Watcher:
    """Sees the registry of gymnasium being imported, once."""

    def find_spec(self, name: str, path: Any = None, target: ModuleType | None = None) -> ModuleSpec | None:
        """As the import system asks."""
        if name != REGISTRY:
            return None
        sys.meta_path.remove(self)
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = _Registering(spec.loader)  # type: ignore[assignment]
        return spec


class _Registering:
    """A loader that registers our ids after what it loads."""

    def __init__(self, loader: Any) -> None:
        self._loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """As what it wraps."""
        found: ModuleType | None = self._loader.create_module(spec)
        return found

    def exec_module(self, module: ModuleType) -> None:
        """Load, then register."""
        self._loader.exec_module(module)
        _register(module)
