"""Bundled scenarios, data sheets, cases and jobs."""
