"""Answers, verdicts and lists as tables for people."""
