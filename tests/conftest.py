"""Shared by all tests; lets them import the modules beside this file."""

import signal

# A shell starts what runs in the background with Ctrl-C ignored, and every process that it starts, too.
signal.signal(signal.SIGINT, signal.default_int_handler)
