"""A row for each reading of one sensor, which a column names, as phones write: `1.25,gyroscope,0.1,0.2,0.3`."""

import csv
import io
from dataclasses import replace

from pbd.files.importers.header_names import is_time, our_name, plain
from pbd.files.importers.refuse_several_devices import MOST_DEVICES, TOP
from pbd.files.table import Sheet


def with_columns_for_each_sensor(sheet: Sheet) -> Sheet:
    """Give each sensor columns of its own, if a column names the sensor and others are its bare axes.

    `t,sensor,x,y,z` becomes `t,gyroscope x,...,accelerometer x,...`; a row's other cells are empty.

    Raises:
        RecordingError: a row has more or fewer cells than the header.
    """
    axes = [k for k, name in enumerate(sheet.header) if plain(name) in ("x", "y", "z")]
    others = [k for k, name in enumerate(sheet.header) if k not in axes and not is_time(name)]
    top = replace(sheet, body=sheet.body[:TOP])
    for k in others if len(axes) == 3 else ():
        words = set(top.words(sheet.header[k]))
        known = {ours[0] for word in words if (ours := our_name(f"{word} x"))} if len(words) <= MOST_DEVICES else ()
        if "ax" in known and "gx" in known:
            break
    else:
        return sheet
    sheet.read(())
    sensors = list(filter(None, dict.fromkeys(sheet.words(sheet.header[k]))))
    kept = [i for i in range(len(sheet.header)) if i not in (k, *axes)]
    header = [sheet.header[i] for i in kept] + [f"{word} {sheet.header[i]}" for word in sensors for i in axes]
    body = io.StringIO()
    writer = csv.writer(body, delimiter=sheet.delimiter, lineterminator="\n")
    for row in csv.reader(io.StringIO(sheet.body), delimiter=sheet.delimiter):
        word = row[k].strip() if row else ""  # an empty line counts too
        writer.writerow(row and [row[i] for i in kept] + [row[i] * (word == each) for each in sensors for i in axes])
    return replace(sheet, header=tuple(header), body=body.getvalue())
