"""Damaged files of every kind that swath reads, and damaged command lines: done, or refused in short.

Within bounded time and memory. For long: `python -m tests.fuzz.run --minutes 60`; in short: `test_short.py`.
"""
