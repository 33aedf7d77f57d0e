"""A scenario as an environment of gymnasium (extra `gym`): twenty lines that steer a combine along the crop edge.

    python examples/gym_steering.py

Put your own policy in place of `steer`; `swath.Env` says what it sees and what it is rewarded for.
"""

import swath

OFFSET, HEADING, CURVATURE = 0, 1, 2  # of the observation


def steer(seen) -> float:
    """Curvature as a share of the tightest turn: towards the edge, along it, the header end 0.1 m out."""
    ahead = 6.0
    aside = seen[OFFSET] + 0.1 + seen[HEADING] * ahead
    return 4.0 * (2.0 * aside / ahead**2 + seen[CURVATURE])


def main() -> None:
    sets = {"run.distance_m": 30, "combine.lidar.level": "empirical"}
    env = swath.Env("straight", sets=sets)
    seen, _ = env.reset(seed=1)
    total, is_over = 0.0, False
    while not is_over:
        seen, reward, terminated, truncated, info = env.step([steer(seen)])
        total, is_over = total + reward, terminated or truncated
    print(f"driven in {info['t_s']:.1f} s, reward {total:.3f}")
    for limit in info["limits"]:
        print(f"{limit['name']:24} {limit['value']:<12.4g} {limit['result']}")
    env.close()


if __name__ == "__main__":
    main()
