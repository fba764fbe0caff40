"""What launchers of MPI, and Slurm's, tell the processes they start, before MPI is asked."""

from __future__ import annotations

import os

_RANKS = ("PMI_RANK", "PMIX_RANK", "PMI_ID", "OMPI_COMM_WORLD_RANK", "MPI_LOCALRANKID", "MV2_COMM_WORLD_RANK")
_SIZES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "MV2_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS")


def launched() -> bool:
    """Whether a launcher started this process, whether or not it has told MPI so."""
    return any(name in os.environ for name in _RANKS) or started() > 1


def started() -> int:
    """How many processes, with this one, a launcher says it has started; 1 if none says anything."""
    return next((int(os.environ[name]) for name in _SIZES if os.environ.get(name, "").isdigit()), 1)


def follows() -> bool:
    """Whether this process is another than the first of those that a launcher has started."""
    return any(os.environ.get(name, "0") != "0" for name in _RANKS)
