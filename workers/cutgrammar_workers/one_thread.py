"""One thread a process: there is one process a CPU, and more threads would compete, and change the order of sums."""

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""The environment that libraries read when they are imported."""
