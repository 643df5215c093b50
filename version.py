"""Version of crosstrack."""

__version__ = "0.2.0"
