"""Stubble as a stand of its own: the stalks of a cereal without ears and leaves."""

from swath.field.crop import BareYield, Habit
from swath.field.plants.cereal import make

HABIT = Habit(make, yields=BareYield)
