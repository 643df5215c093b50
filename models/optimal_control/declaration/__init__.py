"""Declaration of optimal control problems: phases, variables, equations and guesses."""
