"""Files of others, read by libraries of others in a process of its own that can do nothing else.

`call.py` is where such a reader is declared and asked, `serve.py` the process, `confine.py` what takes its
rights, `plain.py` the form of its answers.
"""
