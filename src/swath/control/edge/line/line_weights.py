"""What counts how much in the fit of `near_line`."""

LOOK = 1.5  # m to both sides, over which the track's angle is taken
REACH = 2.5  # m, standard deviation of the weight along the edge
TUKEY, MAD = 4.685, 1.4826
STRAIGHT = 0.0015  # 1/m: prior standard deviation of the bend of an edge that nothing shows to be bent
BENT = 0.05  # 1/m: of any edge
PROVEN = 3.0  # standard deviations from which on a bend is one
