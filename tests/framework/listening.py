"""Callbacks `on_event` that pass on one part of each event."""


def incumbents(receive):
    """Return a callback that passes each incumbent to `receive`."""
    return _passing("incumbent", receive)


def solutions(receive):
    """Return a callback that passes each solution to `receive`."""
    return _passing("solution", receive)


def progress(receive):
    """Return a callback that passes the progress of a campaign to `receive`."""
    return _passing("progress", receive)


def _passing(part, receive):
    def listen(event):
        content = getattr(event, part)
        if content is not None:
            receive(content)

    return listen
