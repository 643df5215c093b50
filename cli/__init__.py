"""Commands of the command line; :mod:`crosstrack.__main__` imports each at first use."""
