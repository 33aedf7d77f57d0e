// As scores.cpp, over the field as profiles along an edge; first finds the station that the scanner is beside.

const int count = beams.count;

const auto& o = beams.origins.data[count / 2];
const double turned_x = profile.turn[0] * o[0] + profile.turn[1] * o[1], turned_y = profile.turn[0] * o[1] - profile.turn[1] * o[0];
const int last_station = profile.x.shape[0] - 1;
int k = station_at.data[world];
for (int round = 0; round < 1000; ++round) {
  const double along = (turned_x - profile.x.data[k]) * profile.cosine.data[k] + (turned_y - profile.y.data[k]) * profile.sine.data[k];
  int next = k + (int)__builtin_floor(along + 0.5);
  next = next < 0 ? 0 : next > last_station ? last_station : next;
  if (next == k) break;
  k = next;
}
station_at.data[world] = k;
const double ahead_x = turned_x - profile.x.data[k], ahead_y = turned_y - profile.y.data[k];
int column = (int)__builtin_floor((ahead_y * profile.cosine.data[k] - ahead_x * profile.sine.data[k]) / profile.column + 0.5) + profile.columns / 2;
column = k * profile.columns + (column < 0 ? 0 : column >= profile.columns ? profile.columns - 1 : column);
const float ground = (float)(profile.z.data[column] + profile.slope_x.data[column] * ahead_x + profile.slope_y.data[column] * ahead_y);
#include "chain.cpp"
