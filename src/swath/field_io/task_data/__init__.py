"""Task data of ISO 11783-10: its files, what they name, and their logs as one table."""
