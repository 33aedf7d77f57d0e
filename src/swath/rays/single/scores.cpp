// Standard normal numbers of the beams of a scan, alike between neighbours: the body of a native function, after vectors.cpp.
//
// AR(1) along each line of the scanner (beams by azimuth, then by line): z[i] = rho z[i-1] + sqrt(1 - rho^2) normal[i], with
// rho = exp(-d / (c0 + c1 spot)) for beams d apart; d and spot where they meet half the crop's height over flat ground.
// In: scene, canopy, apart (between neighbours [rad]), lines, range_max [m]; of the beams origins, directions, normal. Out: score; with no
// lines these are the normal numbers themselves.

const int count = beams.count;

const auto& o = beams.origins.data[count / 2];
const double size = scene.tile_size, c = scene.turn[0], s = scene.turn[1];
const double x = (c * o[0] + s * o[1]) / size * 8.0, y = (c * o[1] - s * o[0]) / size * 8.0;  // in nodes of the ground
const double px = __builtin_floor(x / 64.0), py = __builtin_floor(y / 64.0);
const int i = (int)px - scene.table_x, j = (int)py - scene.table_y, nx = scene.table.shape[1];
const int slot = i < 0 || j < 0 || i >= nx || j >= scene.table.shape[0] ? -1 : scene.table.data[j * nx + i];
float ground = 0.0f;
if (slot >= 0) {
  const int ix = (int)(x - 64.0 * px), iy = (int)(y - 64.0 * py);
  const float u = (float)(x - 64.0 * px) - ix, v = (float)(y - 64.0 * py) - iy;
  const float* g = scene.ground.data + ((size_t)slot * 65 + iy) * 65 + ix;
  ground = (g[0] * (1.0f - u) + g[1] * u) * (1.0f - v) + (g[65] * (1.0f - u) + g[66] * u) * v;
}
#include "chain.cpp"
