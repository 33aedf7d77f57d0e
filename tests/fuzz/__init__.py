"""Damaged files of every kind that swath reads, damaged command lines, and files that want to act.

Done, or refused in short, within bounded time and memory, and nothing acts. For long: `python -m
tests.fuzz.run --minutes 60` and `python -m tests.fuzz.attacks OUT --run`; in short: `test_short.py` and
`test_attacks.py`. Which reader has which kind: `python -m tests.fuzz.readers`.
"""
