// Parabolas through points of an edge: how deep its bites are, the line along them, and where an edge goes on that broke off.
struct Points {  // points beside a line: along it [m], beside it [m], half the square of the first; variance [m2], distance [m]
  int count;
  D along[POINTS], beside[POINTS], bent[POINTS], variance[POINTS], distance[POINTS];

  // those that show the edge from a distance along it [m] on, over a length [m] behind another; the line lies through a place, at
  // an angle [rad]
  void look(const EdgePoints& points, D since, const Arc& place, D length, D angle) {
    const D c = ::cos(angle), s = ::sin(angle);
    count = 0;
    for (int k = 0; k < points.count; ++k) {
      const D* row = points.row(k);
      const bool is_used = row[DISTANCE] > place.distance - length && row[VARIANCE] < VAGUE * VAGUE;
      if (!(row[DISTANCE] >= since) || !is_used) continue;
      const D x = row[0] - place.x, u = row[1] - place.u;
      along[count] = c * x + s * u;
      beside[count] = c * u - s * x;
      bent[count] = 0.5 * along[count] * along[count];
      variance[count] = row[VARIANCE];
      distance[count++] = row[DISTANCE];
    }
  }
};

struct Parabola {
  D p[3], covariance[9];  // offset, slope and bend; their covariance over the variance of a point
  D at(D along, D bent) const { return p[0] + p[1] * along + p[2] * bent; }

  // Weighted least squares; slope_prior, bend_prior: standard deviation of a point over that of slope and bend
  __attribute__((noinline)) void fit(
      const D* along, const D* bent, const D* beside, const D* weight, int n, D slope_prior, D bend_prior) {
    constexpr int ONE[9] = {0, 0, 0, 1, 1, 2, 0, 1, 2}, OTHER[9] = {0, 1, 2, 1, 2, 2, 3, 3, 3};
    D sums[9];
    for (int k = 0; k < 9; ++k)
      sums[k] = sum_of(n, [&](int i) {
        const D of[4] = {1.0, along[i], bent[i], beside[i]};
        return weight[i] * of[ONE[k]] * of[OTHER[k]];
      });
    const D a00 = sums[0] + 1e-3, a01 = sums[1], a02 = sums[2], a12 = sums[4], *b = sums + 6;
    const D a11 = sums[3] + square(slope_prior), a22 = sums[5] + square(bend_prior);
    const D c00 = a11 * a22 - a12 * a12, c01 = a02 * a12 - a01 * a22, c02 = a01 * a12 - a02 * a11;
    const D c11 = a00 * a22 - a02 * a02, c12 = a01 * a02 - a00 * a12, c22 = a00 * a11 - a01 * a01;
    const D det = a00 * c00 + a01 * c01 + a02 * c02;
    const D c[9] = {c00, c01, c02, c01, c11, c12, c02, c12, c22};
    for (int i = 0; i < 3; ++i) p[i] = (c[3 * i] * b[0] + c[3 * i + 1] * b[1] + c[3 * i + 2] * b[2]) / det;
    for (int k = 0; k < 9; ++k) covariance[k] = c[k] / det;
  }
};

// The line along an edge with bites: between its outermost and innermost points, smooth over the bites.
//
// A least squares parabola in which points that lie further in the crop than the line count less (an expectile, Newey and Powell
// 1987, Econometrica 55(4):819). Of bites whose depth is spread evenly from 0 to d, as that of a saw is, it lies
// sqrt(INNER) / (1 + sqrt(INNER)) d = 0.37 d inside the outermost points. What stands out, the scanner sees from afar, the bottom of
// a bite hides behind it: seen, the line lies at 0.1 to 0.2 d.
constexpr D INNER = 0.35, BITES_M = 14.0;  // weight of a point inside the line, where one outside counts 1; m of the edge that count
constexpr D LIKE = 0.33;      // m, standard deviation of a point: bites of 0.6 m, five blocks of which show the same
constexpr D BITES_TURN = 0.07, BITES_BEND = 0.01;  // rad from the machine's heading, 1/m: prior standard deviations
constexpr int FEWEST_POINTS = 8, LOOK_M = 8, ROUNDS = 8;  // in so many points and m bites are looked for; rounds of the expectile
constexpr D EVEN = 0.03, EVEN_TURNS = 0.3, EVEN_BENDS = 0.1;  // m, rad, 1/m: scatter, angle and bend of an edge without bites

struct Bites {
  // How deep the bites of the last metres of an edge are [m], since a distance along it. From what its points scatter about a
  // parabola, beyond their own variance. A saw of depth d gives 0.5 d, as the parabola follows part of it, and blocks are longer
  // than its steps; a bend that begins 0.13 m at most.
  __attribute__((noinline)) static D depth(const EdgePoints& points, D since, const Arc& newest) {
    Points used;
    Parabola line;
    used.look(points, since, newest, LOOK_M, newest.angle);
    const int n = used.count;
    if (n < FEWEST_POINTS) return 0.0;
    D ones[POINTS];
    for (int i = 0; i < n; ++i) ones[i] = 1.0;
    line.fit(used.along, used.bent, used.beside, ones, n, EVEN / EVEN_TURNS, EVEN / EVEN_BENDS);
    const D all = sum_of(n, [&](int i) {
      const D away = used.beside[i] - line.at(used.along[i], used.bent[i]);
      return away * away;
    });
    return EVENLY * __builtin_sqrt(larger(0.0, all / n - mean_of(used.variance, n)));
  }
  // the line abreast of the track's newest place; given back: standard deviation of its angle [rad]; heading: of the machine
  __attribute__((noinline)) static D line(const EdgePoints& points, Arc& arc, D heading) {
    Points used;
    Parabola line;
    used.look(points, -INFINITE, arc, BITES_M, heading);
    D weight[POINTS];
    for (int i = 0; i < used.count; ++i) weight[i] = 1.0;
    for (int round = 0; round < ROUNDS; ++round) {
      line.fit(used.along, used.bent, used.beside, weight, used.count, LIKE / BITES_TURN, LIKE / BITES_BEND);
      for (int i = 0; i < used.count; ++i)
        weight[i] = used.beside[i] > line.at(used.along[i], used.bent[i]) ? INNER : 1.0;
    }
    const D unseen = arc.unseen, x = arc.x - line.p[0] * ::sin(heading), u = arc.u + line.p[0] * ::cos(heading);
    arc.begin(x, u, heading + ::atan(line.p[1]), line.p[2], arc.distance);
    arc.covariance[4] = 0.05 * 0.05, arc.covariance[8] = BITES_BEND * BITES_BEND;
    arc.unseen = unseen;
    return LIKE * __builtin_sqrt(line.covariance[4]);
  }
};

// Where an edge goes on that broke off: along the line or the bend that its last blocks show.
//
// The blocks just before a break were already wrong: rays see into a hole before the middle of their block is there. Several
// explanations are compared: how many of the last blocks were wrong, and whether the edge begins or ends to bend, once at most. Each
// costs the logarithm of its probability; how well it fits the blocks counts for it.
constexpr D STRETCH = 6.0, POINT = 0.03;  // m of the edge that count; m, standard deviation of a block
constexpr int FEWEST_BLOCKS = 4, FREE = 3, MOST_WRONG = 6;  // at least; that may be wrong, by the reach of their rays; and at most
constexpr D BREAK_TURN = 1.0, BREAK_BEND = 0.05;  // rad from the track, 1/m: prior standard deviations
constexpr D WRONG = 6.0, CHANGES = 8.0;  // twice the nat that one more wrong block costs, and a change of bend
constexpr int APART = 2;                 // blocks from one place where the bend may change to the next

struct BrokenLine {
  Points used;
  D weight[POINTS], cost[(MOST_WRONG + 1) * POINTS];
  int counts;  // of explanations

  struct Explanation {
    D cost, state[3], covariance[9];
  };
  // Of the first `count` blocks. change 0: one bend; odd: a bend begins at a place, even: one ends there.
  __attribute__((noinline)) void explain(int count, int change, Explanation& found) const {
    const int places = place_count(count), changes = change == 0 ? 0 : change <= places ? 1 : 2;
    const D since = change == 0 ? 0.0 : used.along[(change - 1) % places * APART], now = changes < 2 ? 1.0 : 0.0;
    D bent[POINTS];
    for (int i = 0; i < count; ++i) {
      const D way = used.along[i] - since, away = now != 0.0 ? larger(way, 0.0) : smaller(way, 0.0);
      bent[i] = 0.5 * (changes ? 1.0 : 0.0) * away * away;
    }
    Parabola line;
    line.fit(used.along, bent, used.beside, weight, count, 1.0 / BREAK_TURN, 1.0 / BREAK_BEND);
    const int wrong = used.count - count - FREE;
    const D away = sum_of(count, [&](int i) {
      const D off = used.beside[i] - line.at(used.along[i], bent[i]);
      return weight[i] * off * off;
    });
    const D fits = away + square(line.p[1] / BREAK_TURN) + square(line.p[2] / BREAK_BEND);
    found.cost = fits + WRONG * (wrong > 0 ? wrong : 0) + CHANGES * changes;
    const D to[9] = {1.0, 0.0, 0.5 * now * square(since), 0.0, 1.0, -now * since, 0.0, 0.0, now};
    Np::times(to, line.p, found.state);
    Np::transform(to, line.covariance, found.covariance);
  }
  static int place_count(int count) { return count > APART ? (count - APART + APART - 1) / APART : 0; }
  int fewest() const { return used.count - MOST_WRONG > FEWEST_BLOCKS ? used.count - MOST_WRONG : FEWEST_BLOCKS; }

  // The track as it goes on from its place, in the place of `arc`; given back: the distance along the edge behind which it breaks off
  // [m]. The mean of all explanations by their likelihood. scatter: of blocks about the track, beyond their own variance [m2]
  __attribute__((noinline)) D carry_on(const EdgePoints& points, Arc& arc, D scatter) {
    used.look(points, -INFINITE, arc, STRETCH, arc.angle);
    for (int i = 0; i < used.count; ++i) weight[i] = 1.0 / larger(used.variance[i] + scatter, POINT * POINT);
    Explanation one;
    int n = 0, best = 0;
    D last = arc.distance;
    for (int count = used.count; count >= fewest(); --count)
      for (int change = 0; change <= 2 * place_count(count); ++change) {
        explain(count, change, one);
        cost[n] = one.cost;
        if (n == 0 || cost[n] < cost[best]) best = n, last = used.distance[count - 1];
        ++n;
      }
    if (n == 0) arc.bend = 0.0;
    if (n == 0) return last;
    const D least = cost[best];
    for (int i = 0; i < n; ++i) cost[i] = ::exp(-0.5 * (cost[i] - least));
    const D all = sum(cost, n);
    D state[3] = {}, covariance[9] = {};
    for (int round = 0; round < 2; ++round) {
      int i = 0;
      for (int count = used.count; count >= fewest(); --count)
        for (int change = 0; change <= 2 * place_count(count); ++change, ++i) {
          explain(count, change, one);
          const D chance = cost[i] / all;
          for (int k = 0; round == 0 && k < 3; ++k) state[k] += chance * one.state[k];
          for (int k = 0; round == 1 && k < 9; ++k) {
            const D apart = (one.state[k / 3] - state[k / 3]) * (one.state[k % 3] - state[k % 3]);
            covariance[k] += chance * (one.covariance[k] + apart);
          }
        }
    }
    D at[2];
    arc.beside(state[0], at);
    arc.x = at[0], arc.u = at[1], arc.angle += ::atan(state[1]), arc.bend = state[2];
    for (int k = 0; k < 9; ++k) arc.covariance[k] = covariance[k];
    return last;
  }
};
