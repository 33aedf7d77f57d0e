// Points of the accepted blocks, in the frame at rest: rows of x, u [m], variance [m2] and distance along the edge [m], the newest
// POINTS; returns: distances along the edge at which it was found again behind a hole [m], the newest RETURNS.
constexpr int VARIANCE = 2, DISTANCE = 3;
constexpr D BEHIND = 14.0;   // m of the edge that are kept
constexpr D SAME = 1e-6;     // m along an edge: one place

struct EdgePoints : EdgePointsRow {
  void clear() { count = return_count = 0.0; }
  const D* row(int k) const { return rows + COLUMNS * k; }
  void add(D x, D u, D variance, D distance) {
    const D row[COLUMNS] = {x, u, variance, distance};
    keep(rows, count, COLUMNS, DISTANCE, distance - BEHIND - 10.0, INFINITE);
    push(rows, count, COLUMNS, POINTS, row);
    keep(returns, return_count, 1, 0, distance - BEHIND, INFINITE);
  }
  void found_again(D distance) { push(returns, return_count, 1, RETURNS, &distance); }  // behind a hole, so far along the edge [m]
  void doubt(D distance) { keep(rows, count, COLUMNS, DISTANCE, -INFINITE, distance); }  // forget those from there on
  void move(D distance, D dx, D du, D along) {  // those at a distance along the edge; all [m]
    for (D* row = rows; row < rows + COLUMNS * (int)count; row += COLUMNS)
      if (__builtin_fabs(row[DISTANCE] - distance) < SAME) row[0] += dx, row[1] += du, row[DISTANCE] += along;
  }
};
