// After all that looks at blocks: the rows of a world.
Row& row = *(Row*)m.row.data;
BlockTrack& t = *(BlockTrack*)track.data;
Block block{row.counted, m.counts.data, m.solid.data, (Answer*)m.answers.data};
t.spread = row.detector.search, t.forget = row.detector.hold + AHEAD_M, t.spacing = row.detector.spacing, t.view = row.detector.view;
