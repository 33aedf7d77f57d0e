"""Damaged files of every kind that swath reads, and damaged command lines: valid, or a short error, in bounded time and memory.

For long: `python -m tests.fuzz.run --minutes 60`. A short seed of it is `test_short.py`.
"""
