"""Bundles of sub-rays, and how to compare what two ways of casting them hit."""

import numpy as np

TENTH = 1e-4  # 0.1 mm


def bundles(origin, azimuth, depression, subs, *, width=0.006, exit_diameter=0.0, turn=0.0):
    """Beams from one origin along azimuths and a depression [rad]: origins, directions (n, subs, 3)."""
    azimuth, depression = np.broadcast_arrays(np.asarray(azimuth, float), np.asarray(depression, float))
    ring = np.arange(subs)
    radius, angle = np.sqrt((ring + 0.5) / subs), ring * 2.399963 + turn
    u, v = radius * np.cos(angle), radius * np.sin(angle)
    ca, sa, cd, sd = (f(x)[:, None, None] for x in (azimuth, depression) for f in (np.cos, np.sin))
    ahead = np.concatenate([ca * cd, sa * cd, -sd], axis=2)
    left = np.concatenate([-sa, ca, 0 * sa], axis=2)
    up = np.concatenate([ca * sd, sa * sd, cd], axis=2)
    d = ahead + 0.5 * width * (u[:, None] * left + v[:, None] * up)
    d /= np.linalg.norm(d, axis=2, keepdims=True)
    o = np.asarray(origin, float) + 0.5 * exit_diameter * (u[:, None] * left + v[:, None] * up)
    return np.ascontiguousarray(np.broadcast_to(o, d.shape)), d


def same_share(found, expected):
    """Share of rays with the same range within 0.1 mm, or no hit in both."""
    a, b = found.distance.ravel(), expected.distance.ravel()
    return float(np.mean((np.abs(a - b) < TENTH) | (np.isnan(a) & np.isnan(b))))


def check_same(found, expected, *, least=0.999):
    """Ranges within 0.1 mm for a share of the rays, and of those organ, cosine and reflectance alike."""
    assert same_share(found, expected) >= least
    a, b = found.distance.ravel(), expected.distance.ravel()
    near = np.abs(a - b) < TENTH
    assert np.mean(found.organ.ravel()[near] == expected.organ.ravel()[near]) >= least
    assert np.mean(np.abs(found.cosine.ravel() - expected.cosine.ravel())[near] < 2e-2) >= least
    same = near & (found.organ.ravel() == expected.organ.ravel())
    np.testing.assert_array_equal(found.reflectance.ravel()[same], expected.reflectance.ravel()[same])
