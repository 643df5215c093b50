from ..paper import Paper
from .printed import FIGURE_5, FIGURE_7, TABLE_3, TABLE_4, TABLE_5, TABLE_6

PAPER = Paper("messenger", "x", (), (TABLE_3, TABLE_4, TABLE_5, TABLE_6, FIGURE_5, FIGURE_7))
