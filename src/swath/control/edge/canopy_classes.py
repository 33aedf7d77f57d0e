"""Classes and places of what rays answer in the canopy, and what belongs to the ground beside it."""

NEAR, FAR = 1.0, 25.0  # m: nearer echoes are dust or chaff at the scanner
LAYER, LOWEST, LAYERS = 0.06, -0.3, 46  # m, m, number: the layers of height that make the classes
DUST, NOTHING, CLASSES = LAYERS, LAYERS + 1, LAYERS + 2  # two more: above the crop or near, no echo at all
HEADROOM, ROOM = 1.25, 0.3  # [1], [m]: an echo this much above the crop's height is no crop
LIMIT = 0.3  # of the crop's height: a ray below it has gone on
INWARD = 0.03  # m at most, of its way that a ray going into the crop counts before its end
OUTWARD, OUTWARD_SHARE = 0.12, 0.35  # m at most, share of its way: the same of a ray coming out of it
REPEATS = 0.1  # of its range: an echo so near that of its beam a scan before stands, others hang in the air
STEEPEST = -0.05  # a beam that falls less than this per metre never reaches the ground
CELL, HALF = 0.025, 4.0  # m: width of a place, and how far to either side places are counted
PLACES = round(2 * HALF / CELL)
GROUND_REACH, GROUND_NEAR = 0.6, 1.5  # m: of the heights about the plane before; nearer echoes are puffs
GROUND_MOST, GROUND_LEAST = 1.0, -4.0  # m above the machine's own ground plane: higher are puffs
GROUND_SPREAD = 0.08  # m: echoes this far from the plane count a quarter
