"""Reading a figure: what tests of pictures look for."""

from matplotlib.text import Text


def panels(figure):
    """Return the axes by the first words of their label."""
    return {axes.get_ylabel().split("\n(")[0].replace("\n", " "): axes for axes in figure.axes}


def artists(axes, gid):
    """Return the lines, collections and patches of one kind."""
    return [one for one in (*axes.lines, *axes.collections, *axes.patches) if one.get_gid() == gid]


def heights(axes, gid="limit"):
    """Return the heights at which the lines of one kind stand."""
    return sorted({float(y) for line in artists(axes, gid) for y in line.get_ydata()})


def legend(figure):
    """Return the words of all legends of the figure, but not of its axes."""
    found = [*figure.legends, *(one for part in figure.subfigs for one in part.legends)]
    return [text.get_text() for one in found for text in one.get_texts()]


def words(figure):
    """Return every text of the figure."""
    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


def render(figure):
    """Lay out and draw everything, without the cost of pixels."""
    figure.draw_without_rendering()
    return figure
