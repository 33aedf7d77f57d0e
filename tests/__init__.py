import os

# before numpy is loaded: OpenBLAS's threads spin over small matrices, on all cores
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
