"""The models' formulations as programs, one file each."""
