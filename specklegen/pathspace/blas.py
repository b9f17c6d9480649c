"""Matrix products on one thread: more would change their last bits, and the blocks around them are parallel."""

from threadpoolctl import threadpool_limits


def one_blas_thread() -> threadpool_limits:
    """Context in which NumPy's and SciPy's matrix products run on one thread."""
    return threadpool_limits(1, user_api="blas")
