"""Work shared among the ranks of MPI: `mpiexec -n 4 luxel ...`, with the extra `mpi`. Without it there is one rank, and all of this works."""
