"""Numbers that are alike between neighbouring beams."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.rays.device import start_warp

F64 = NDArray[np.float64]


class Chain:
    """First-order autoregressive chains for a fixed scan pattern, prepared once.

    count: beams, ordered by azimuth, then by line; line_count: beams that share an azimuth
    """

    def __init__(self, count: int, line_count: int = 1) -> None:
        self._noise, self._keep, self._out = (np.zeros((count // line_count, line_count)) for _ in range(3))
        self._launch: Any = None

    def __call__(self, noise: F64, rho: F64) -> F64:
        """Chains of noise (count,) with the correlation rho (count,) of each beam with the one before.

        z[0] = noise[0], z[i] = rho[i] z[i-1] + sqrt(1 - rho[i]^2) noise[i]
        """
        self._noise.reshape(-1)[:] = noise
        self._keep.reshape(-1)[:] = rho
        if self._launch is None:
            self._launch = self._prepare()
        if self._out.size:
            self._launch.launch()
        return self._out.ravel().copy()

    def _prepare(self) -> Any:
        wp = start_warp()
        from swath.rays.kernel.chain import chain_lines

        arrays = [
            wp.array(a, dtype=wp.float64, device="cpu", copy=False)
            for a in (self._noise, self._keep, self._out)
        ]
        lines = self._out.shape[1] if self._out.size else 0
        return wp.launch(chain_lines, dim=lines, inputs=arrays, device="cpu", record_cmd=True)
