"""Classes and places of what rays answer in the canopy, and what belongs to the ground beside it."""

# m: nearer echoes are of the air or the window at the scanner, and nothing behind answered louder
NEAR, FAR = 1.5, 25.0
LAYER, LOWEST, LAYERS = 0.06, -0.3, 46  # m, m, number: the layers of height that make the classes
# three more: an echo above the crop, none at all, and one nearer than NEAR
DUST, NOTHING, AIR, CLASSES = LAYERS, LAYERS + 1, LAYERS + 2, LAYERS + 3
HEADROOM, ROOM = 1.25, 0.3  # [1], [m]: an echo this much above the crop's height is no crop
LIMIT = 0.3  # of the crop's height: a ray below it has gone on
INWARD = 0.03  # m at most, of its way that a ray going into the crop counts before its end
OUTWARD, OUTWARD_SHARE = 0.12, 0.35  # m at most, share of its way: the same of a ray coming out of it
REPEATS = 0.1  # of its range: an echo so near that of its beam a scan before stands, others hang in the air
STEEPEST = -0.05  # a beam that falls less than this per metre never reaches the ground
LEAST_FALL = -1e-3  # per metre, over the plane of the stubble: no ray falls less
BLOCK = 0.4  # m of travel of a block
CELL, HALF = 0.025, 4.0  # m: width of a place, and how far to either side places are counted
PLACES = round(2 * HALF / CELL)
GROUND_REACH = 0.6  # m: of the heights about the plane before
GROUND_MOST, GROUND_LEAST = 1.0, -4.0  # m above the machine's own ground plane: higher are puffs
GROUND_SPREAD = 0.08  # m: echoes this far from the plane count a quarter
OUTSIDE_FAR, OUTSIDE_NEAR = -3.5, -0.25  # m beside the edge: where the stubble is looked at
