// Directions and random numbers of a packet of 16 beams: the body of a native function, after rays/single/vectors.cpp and philox.cpp.
//
// Beam n of the scan at t draws the words 4 n to 4 n + 3 of the stream's generator `Stream.at(t)`, whatever else is drawn: block
// n + 1 of Philox. The first two make two standard normal numbers (Box and
// Muller 1958, doi:10.1214/aoms/1177706645).
// In: p, the packet; sweep (see `Aiming` in kernel.py); of the beams origins. Out, of the beams: directions (n, 3), normal (2, room) where they are drawn, flags: 1 where a number is not finite.

const int count = beams.count;

const int start = p * N, room = beams.normal.shape[1];
float u[2][N];
for (int l = 0; l < N; ++l) u[0][l] = u[1][l] = 0.5f;
bool is_finite = true;
for (int l = 0; l < N && start + l < count; ++l) {
  const int n = start + l;
  const double *r = (const double*)sweep.rotations.data + 9 * (size_t)n, *f = (const double*)sweep.forward.data + 3 * (size_t)n;
  const double* o = (const double*)beams.origins.data + 3 * (size_t)n;
  double *d = (double*)beams.directions.data + 3 * (size_t)n, sum = o[0] + o[1] + o[2];
  for (int i = 0; i < 3; ++i) sum += d[i] = r[3 * i] * f[0] + r[3 * i + 1] * f[1] + r[3 * i + 2] * f[2];
  is_finite &= sum - sum == 0.0;
  if (!sweep.is_drawn) continue;
  W words[4];
  philox((W)n + 1, sweep.words.data[2], sweep.words.data[0], sweep.words.data[1], words);
  u[0][l] = ((float)(words[0] >> 40) + 0.5f) * 5.9604645e-8f;
  u[1][l] = ((float)(words[1] >> 40) + 0.5f) * 5.9604645e-8f;
}
if (sweep.is_drawn) {
  const F far = root(-2.0f * log_of(load(u[0]))), turn = load(u[1]);
  store(beams.normal.data + start, far * sine_of_turns(turn + 0.25f));
  store(beams.normal.data + room + start, far * sine_of_turns(turn));
}
if (!is_finite) beams.flags.data[0] |= 1;
