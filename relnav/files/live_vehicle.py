"""A vehicle's log whose rows are still coming: a row that is none is told and left out."""

from collections.abc import Iterator

from relnav.errors import LogError
from relnav.files.live_log import Refusals
from relnav.files.text_table import TextTable
from relnav.files.vehicle_log import Row, opened_vehicle_log, row_of, widths
from relnav.spacecraft import Vehicle


def live_rows(table: TextTable, vehicle: Vehicle, refusals: Refusals) -> Iterator[Row]:
    """The observations of a vehicle's log as they come.

    Raises
    ------
    LogError
        For a header of another log, and for what is no text table any more.
    """
    opened_vehicle_log(table)
    counts = widths(vehicle)
    for begin, block in table.blocks():
        for number, line in enumerate(block.split(b"\n")[:-1], begin):
            table.last_row = number - 1
            try:
                for found in table.rows_of(number, line + b"\n"):
                    row, before = row_of(table, *found, vehicle, counts), refusals.count
                    yield row
                    if refusals.count == before:  # the filter has not refused it either
                        refusals.row()
            except LogError as error:
                refusals.refuse(error)
