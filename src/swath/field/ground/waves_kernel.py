"""Sums of waves at the crossings of a lattice, compiled: as `einsum` adds them, in the same order."""

import threading
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from swath.kernels import repeatable, shared

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

# Tiles of 4 x 8 crossings, whose sums stay in registers; each adds wave after wave, a product and then a sum.
_SUM = """
constexpr int ROWS = 4, COLUMNS = 8;
const double *a = (const double*)job.data[0], *b = (const double*)job.data[1];
double* z = (double*)job.data[2];
const long long rows = job.data[3], columns = job.data[4], waves = job.data[5];
for (long long v = 0; v < rows; v += ROWS) {
  for (long long u = 0; u < columns; u += COLUMNS) {
    const long long m = rows - v < ROWS ? rows - v : ROWS, n = columns - u < COLUMNS ? columns - u : COLUMNS;
    if (m == ROWS && n == COLUMNS) {
      double sum[ROWS][COLUMNS] = {};
      for (long long k = 0; k < waves; ++k) {
        const double* line = b + k * columns + u;
        for (int i = 0; i < ROWS; ++i) {
          const double share = a[(v + i) * waves + k];
          for (int j = 0; j < COLUMNS; ++j) sum[i][j] += share * line[j];
        }
      }
      for (int i = 0; i < ROWS; ++i)
        for (int j = 0; j < COLUMNS; ++j) z[(v + i) * columns + u + j] = sum[i][j];
    } else {
      for (int i = 0; i < m; ++i)
        for (int j = 0; j < n; ++j) {
          double sum = 0.0;
          for (long long k = 0; k < waves; ++k) sum += a[(v + i) * waves + k] * b[k * columns + u + j];
          z[(v + i) * columns + u + j] = sum;
        }
    }
  }
}
"""


@wp.func_native(_SUM)
def sum_tiles(job: wp.array(dtype=wp.int64)): ...


@wp.kernel
def sum_waves(job: wp.array(dtype=wp.int64)):
    """job: addresses of both factors and of the sums, rows, columns, waves."""
    sum_tiles(job)


class _Launches(threading.local):
    """The compiled kernel with its job; every thread has its own."""

    @cached_property
    def sum(self) -> tuple[np.ndarray, Any]:
        job = np.zeros(6, np.int64)
        return job, repeatable(sum_waves, [shared(job)])


_LAUNCHES = _Launches()


def sum_products(along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Sum over k of along[v, k] * across[k, u], shapes (m, n) and (n, l), contiguous."""
    sums = np.empty((len(along), across.shape[1]))
    job, launch = _LAUNCHES.sum
    job[:] = along.ctypes.data, across.ctypes.data, sums.ctypes.data, *sums.shape, len(across)
    launch.launch()
    return sums
