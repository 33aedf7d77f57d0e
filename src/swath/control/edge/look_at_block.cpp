// Looks at the block of a world, where it is full. Of one whose edge is followed the rays are told for the overhang: beside the edge
// where they are at the crop's top and at the lower limit, and how high they end [m], then ground 0, height of the crop, lower limit [m], overhang
// at first [m], and whether that is to be fitted; given back: how many rays, -1 of another block. ends: the look's end instead, what its
// rays say of the feet, and what is told of it all; found: overhang [m], nan where none was fitted.
if (ends && row.canopy.is_full != 0.0) {
  row.canopy.is_full = 0.0;
  if (t.accepted.is_seen != 0.0) t.feet.learn(block, t.accepted, t.spacing, found);
  if (t.is_done != 0.0) block.clear();
  t.tell(row);
}
if (ends) return -1;
t.is_done = t.accepted.is_seen = 0.0;
if (row.canopy.is_full == 0.0) return -1;
const auto& edge = row.canopy;
t.lodging.stubble = row.ground.plane;
D* lines[4];
for (int k = 0; k < 4; ++k) lines[k] = m.told.data + k * m.told.shape[1];
const EdgeFrame frame = {edge.edge_x, edge.edge_u, edge.edge_angle, edge.edge_bend};
t.look(block, frame, At{row.step.x, row.step.u, row.step.heading}, lines[0]);
if (t.accepted.is_seen == 0.0) return -1;
t.feet.move(block.row.travel);
int n = 0;
for (int k = 0; k < block.row.rays; ++k) {
  const Answer& answer = block.answers[k];
  if (!__builtin_isfinite(answer.height)) continue;
  lines[0][n] = answer.upper - t.accepted.beside;
  lines[1][n] = answer.lower - t.accepted.beside;
  lines[2][n++] = answer.height;
}
const D height = t.accepted.height, all[] = {0.0, height, LIMIT * height, CanopyFeet::guess(height), (D)(t.feet.since >= OFTEN)};
for (int k = 0; k < 5; ++k) lines[3][k] = all[k];
return n;
