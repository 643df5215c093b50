"""What is particular to optimal control on the side of the solvers."""
