"""What was measured, as the table of the arbiter's documentation."""

from __future__ import annotations

from fsw_analysis.report import table

TABLE_MARKS = ("<!-- measured by test/faults: begin -->", "<!-- measured: end -->")


class Table:
    """Collects what was measured, the worst of each fault, for the table of the documentation."""

    def __init__(self):
        self.rows = {}

    def add(self, fault, detected, reaction, outcome):
        worst = self.rows.get(fault)
        figures = (outcome.lost, outcome.depth_mm, outcome.temperature_c)
        figures = figures if worst is None else tuple(map(max, worst[2], figures))
        self.rows[fault] = (detected, reaction, figures)

    def write(self, path):
        rows = [("fault", "detected by", "reaction", "ticks lost", "worst deviation")]
        for fault, (detected, reaction, (lost, depth_mm, temperature_c)) in self.rows.items():
            rows.append(
                (
                    fault,
                    detected,
                    reaction,
                    lost,
                    f"{1e3 * depth_mm:.1f} µm, {temperature_c:.1f} °C",
                )
            )
        begin, end = TABLE_MARKS
        text = path.read_text(encoding="utf-8")
        before, after = text.split(begin)[0], text.split(end)[1]
        path.write_text(
            f"{before}{begin}\n\n{table(rows, words=None)}\n\n{end}{after}", encoding="utf-8"
        )
