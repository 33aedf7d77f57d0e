"""Targets that fluctuate as Swerling 1."""


def detection_probability(snr, false_alarm):
    """Of one look. snr: mean, linear."""
    return false_alarm ** (1.0 / (1.0 + snr))
