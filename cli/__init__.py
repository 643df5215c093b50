"""The commands of the command line; :mod:`crosstrack.__main__` loads each when it is asked for."""
