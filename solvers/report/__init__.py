"""Tables of answers, verdicts and lists."""
