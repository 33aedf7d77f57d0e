"""Shared by all tests; lets them import the modules beside this file."""
