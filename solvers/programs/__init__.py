"""Parts shared by the solvers of programs: attempts, scaling, and adapters of libraries."""
