// Ends the look at a block that is full: what its rays say of the feet, and what is told of it all. found: overhang [m], nan where none
// was fitted
if (row.canopy.is_full == 0.0) return;
row.canopy.is_full = 0.0;
if (t.accepted.is_seen != 0.0) t.feet.learn(block, t.accepted, t.spacing, found);
if (t.is_done != 0.0) block.clear();
t.tell(row);
