// Rows of `width` numbers one after the other: one more, in the place of the oldest where there is no room; those of which a number lies
// between two limits.
static constexpr auto push = [](D* rows, D& count, int width, int room, const D* row) {
  const bool is_full = count == room;
  for (int k = width; is_full && k < width * room; ++k) rows[k - width] = rows[k];
  if (!is_full) count += 1.0;
  for (int k = 0; k < width; ++k) rows[width * ((int)count - 1) + k] = row[k];
};
static constexpr auto keep = [](D* rows, D& count, int width, int which, D low, D high) {
  int kept = 0;
  for (int i = 0; i < count; ++i) {
    const D* row = rows + width * i;
    if (!(row[which] > low && row[which] < high)) continue;
    for (int k = 0; k < width; ++k) rows[width * kept + k] = row[k];
    ++kept;
  }
  count = kept;
};
