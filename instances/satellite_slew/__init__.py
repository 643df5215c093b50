"""Instances of satellite slews: the paper's, other axes and angles, reserves, and one without a plan."""
