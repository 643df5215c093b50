"""Reference simulator of all aspects in plain Python, and a brute-force search for the fewest steps."""

from fractions import Fraction

#: Change of row and column per letter.
STEPS = {
    "U": (-1, 0), "D": (1, 0), "L": (0, -1), "R": (0, 1), "W": (0, 0),
    "Q": (-1, -1), "E": (-1, 1), "Z": (1, -1), "C": (1, 1),
}  # fmt: skip


class Plain:
    """Map of one scene with its rules; the moving obstacles are lists of cells per step."""

    def __init__(self, model, scene, tracks=()):
        self.model = model
        self.map = model.blocked[scene].tolist()
        self.target, self.start = (tuple(x[scene].tolist()) for x in (model.targets, model.starts))
        self.tracks = [list(map(tuple, track)) for track in tracks]
        self.past = {"free": 0, "one": 1, "any": 2}[model.corners]

    def wall(self, cell):
        row, column = cell
        return (
            not (0 <= row < len(self.map) and 0 <= column < len(self.map[0]))
            or self.map[row][column]
        )

    def letters(self):
        wait = "W" if self.tracks else ""
        return ("UDLR" if self.model.connectivity == "4" else "UDLRQEZC") + wait

    def step(self, cell, time, letter):
        """Return the cell after a step that begins at `time`, and whether a collision occurred."""
        down, across = STEPS[letter]
        to = cell[0] + down, cell[1] + across
        hit = self.wall(to)
        if down and across:
            hit |= (
                self.wall((cell[0] + down, cell[1])) + self.wall((cell[0], cell[1] + across))
                > self.past
            )
        for track in self.tracks:
            # Positions along the step, at its middle and at its end.
            for share in (Fraction(1, 2), Fraction(1)):
                vehicle = tuple(a + share * (b - a) for a, b in zip(cell, to, strict=True))
                other = tuple(
                    a + share * (b - a) for a, b in zip(track[time], track[time + 1], strict=True)
                )
                hit |= vehicle == other
        return (cell, True) if hit else (to, False)

    def fewest(self):
        """Return the fewest steps and the fewest collisions of these, by a search over cells and times."""
        layer = {self.start: 0}
        for time in range(self.model.steps):
            following = {}
            for cell, hits in layer.items():
                for letter in self.letters() + "W" * (not self.tracks):
                    to, hit = self.step(cell, time, letter)
                    following[to] = min(following.get(to, 10**9), hits + hit)
            layer = following
            if self.target in layer:
                return time + 1, layer[self.target]
        return None


def crosses(box, middle, end):
    """Return whether a segment between centres passes through the open interior of a cell (exact arithmetic)."""
    low, high = Fraction(0), Fraction(1)
    for axis in (0, 1):
        begin, length = Fraction(middle[axis]), Fraction(end[axis] - middle[axis])
        first, last = Fraction(2 * box[axis] - 1, 2), Fraction(2 * box[axis] + 1, 2)
        if length == 0:
            if not first < begin < last:
                return False
            continue
        one, other = sorted(((first - begin) / length, (last - begin) / length))
        low, high = max(low, one), min(high, other)
    return low < high


def visible(blocked, middle, end):
    """Return whether a cell is in line of sight of another one, for cells of a view given as a set."""
    if any(cell not in (middle, end) and crosses(cell, middle, end) for cell in blocked):
        return False
    down, across = end[0] - middle[0], end[1] - middle[1]
    for row in range(min(middle[0], end[0]), max(middle[0], end[0])):
        for column in range(min(middle[1], end[1]), max(middle[1], end[1])):
            # The corner below row and right of column is on the segment, and two diagonal cells touch there.
            r, c = Fraction(2 * row + 1, 2) - middle[0], Fraction(2 * column + 1, 2) - middle[1]
            pair = (
                ((row, column + 1), (row + 1, column))
                if down * across > 0
                else ((row, column), (row + 1, column + 1))
            )
            if r * across == c * down and all(cell in blocked for cell in pair):
                return False
    return True
