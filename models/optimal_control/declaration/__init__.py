"""Declaring an optimal control problem: phases, variables, equations, guesses."""
