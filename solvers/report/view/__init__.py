"""Pages that show plans: pictures to zoom, animations to play, and the checks beside them."""
