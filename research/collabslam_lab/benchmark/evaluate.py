"""``collabslam-lab evaluate``: everything a plan asks for, and the files it leaves."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from collabslam.batch.engines import LOCAL, Engine
from collabslam.errors import DataError, SettingsError
from collabslam.extras import drawing
from collabslam.formats.files import write_text
from collabslam.runs.results import write_summary
from collabslam.version import version
from collabslam_lab.benchmark import ablation, accuracy, blackout, descriptors, leave_one_out, overall
from collabslam_lab.benchmark.figures import differences, medians, split
from collabslam_lab.benchmark.leave_one_out import Candidates
from collabslam_lab.benchmark.plan import Plan, find_plan
from collabslam_lab.benchmark.running import estimate, outcome, run_items
from collabslam_lab.benchmark.store import Item, Row
from collabslam_lab.benchmark.studies import ABLATION, ACCURACY, BLACKOUT, CHOOSE, DESCRIPTORS


@dataclass(frozen=True)
class Choice:
    """What of a plan is run, and how.

    Attributes
    ----------
    plan : Path or None
        The YAML; the folder's own or the package's if left out.
    only : sequence of str
        Names of recordings; all if empty.
    seeds : sequence of int
        In place of the plan's; empty for those.
    modes : sequence of str
        Of the modes of each recording, only these; all if empty.
    study : str or None
        Of `STUDIES`, instead of running the recordings as they are.
    changes : mapping
        Changes of the settings of every run.
    jobs : int
        Processes at a time.
    engine : Engine
        Where they run.
    again : bool
        Run also what is done.
    dry : bool
        Only say what there is to do.
    against : Path or None
        Result folder of an earlier evaluation to compare with, row by row.
    candidates : Candidates or None
        Values of a setting that recordings choose among, each one left out in turn, instead of a study.
    """

    plan: Path | None = None
    only: Sequence[str] = ()
    seeds: Sequence[int] = ()
    modes: Sequence[str] = ()
    study: str | None = None
    changes: Mapping[str, Any] = field(default_factory=dict)
    jobs: int = 2
    engine: Engine = LOCAL
    again: bool = False
    dry: bool = False
    against: Path | None = None
    candidates: Candidates | None = None

    @property
    def has_levers(self) -> bool:
        """Whether runs are those of the plan's levers, or of a setting's candidates in their place."""
        return self.study == ABLATION or self.candidates is not None


def evaluate(data: Path, out: Path, choice: Choice | None = None) -> list[Row]:
    """Run a plan's recordings, or its levers, and write JSON, Markdown and a picture.

    What is done already, with the same recording, settings, options and version, is not run again.  A
    recording that is missing is named and left out; a run that fails is a row that says why.

    Parameters
    ----------
    data : Path
        Folder that holds the recordings.
    out : Path
        Gets ``evaluate.json``, ``evaluate.md``, ``evaluate.png`` and ``runs``, a result folder for each run;
        or ``STUDY.json``, ``STUDY.md`` and what runs leave in ``STUDY``.
    choice : Choice, optional

    Returns
    -------
    list of dict
        A row for each run: the keys of ``summary.json`` with ``recording``, ``mode``, ``seed``,
        ``bias_per_block``, ``independent`` and ``status``; a failed one has ``error`` in place of results.

    Raises
    ------
    DataError
        If the data folder does not exist, or the results cannot be written.
    SettingsError
        If the plan or an option is not allowed.
    """
    choice = choice or Choice()
    if choice.dry and choice.study not in (None, ABLATION):
        raise SettingsError(
            f"--dry-run counts the plan's runs, and --{choice.study} makes others; leave it out."
        )
    before = None if choice.against is None else overall.read(choice.against)
    if not data.is_dir():
        raise DataError(f"The data folder {data} does not exist; give the folder that holds the recordings.")
    plan = chosen(find_plan(data, choice.plan), choice)
    missing = [e.name for e in plan.recordings if not (e.rendered or (data / e.folder).exists())]
    for name in missing:
        print(f"{name}: not in {data}, left out", flush=True)
    present = [e.name for e in plan.recordings if e.name not in missing]
    if choice.study == DESCRIPTORS:
        return _compare_descriptors(plan, data, out, present, choice)
    if choice.study == BLACKOUT:
        return _lose_sight(plan, data, out, present, choice)
    items = _items(plan, data, out, present, choice)
    todo = [item for item in items if choice.again or item.done() is None]
    minutes = estimate(todo) / 60.0
    print(
        f"{len(items)} runs, {len(items) - len(todo)} done already; about {minutes:.0f} minutes on one core, "
        f"{choice.jobs} at a time",
        flush=True,
    )
    if choice.dry:
        for item in items:
            print(f"  {'to do' if item in todo else 'done '}  {item.title}")
        return []
    name = CHOOSE if choice.candidates is not None else ABLATION if choice.has_levers else ACCURACY
    report = _Report(plan, items, missing, out / f"{name}.json")
    rows = run_items(items, jobs=choice.jobs, told=report.told, again=choice.again, engine=choice.engine)
    report.write(rows)
    how = command(choice)
    if choice.candidates is not None:
        text = leave_one_out.page(plan, rows, choice.candidates, how)
    elif choice.has_levers:
        text = ablation.page(plan, rows, how)
    else:
        text = accuracy.page(plan, rows, missing, how)
    if before is not None:
        text += f"\n## Compared with {choice.against}\n\n{overall.compared(report.medians(rows), before)}\n"
    write_text(out / f"{name}.md", text)
    print("\n" + text)
    if rows and name == ACCURACY and drawing():
        from collabslam_lab.benchmark.pictures import plot_rows

        plot_rows(plan, rows, out / f"{name}.png")
    return rows


def command(choice: Choice) -> str:
    """The command line of a choice."""
    words = ["collabslam-lab", "evaluate", "DATA"]
    words += [] if choice.plan is None else ["--plan", choice.plan.name]
    words += ["--only", ",".join(choice.only)] if choice.only else []
    words += ["--seeds", ",".join(map(str, choice.seeds))] if choice.seeds else []
    words += ["--modes", ",".join(choice.modes)] if choice.modes else []
    words += [] if choice.study is None else [f"--{choice.study}"]
    if choice.candidates is not None:
        words += ["--choose", f"{choice.candidates.key}={','.join(map(str, choice.candidates.values))}"]
    for key, value in choice.changes.items():
        words += ["--set", f"{key}={value}"]
    return " ".join(words)


def chosen(plan: Plan, choice: Choice) -> Plan:
    """The plan with only what was asked for; raises SettingsError for a name that it does not have."""
    names = [entry.name for entry in plan.recordings]
    for name in choice.only:
        if name not in names:
            raise SettingsError(
                f"There is no recording '{name}' in {plan.origin}; it has {', '.join(names)}."
            )
    entries = [e for e in plan.recordings if not choice.only or e.name in choice.only]
    if choice.modes:
        wanted = set(choice.modes)
        entries = [
            replace(
                e,
                modes=tuple(m for m in e.modes if m in wanted),
                independent=tuple(m for m in e.independent if m in wanted),
            )
            for e in entries
        ]
    levers = plan.ablation
    if choice.seeds:
        levers = replace(levers, seeds=tuple(choice.seeds))
    if choice.modes:
        levers = replace(levers, modes=tuple(choice.modes))
    plan = replace(plan, recordings=tuple(entries), seeds=tuple(choice.seeds) or plan.seeds, ablation=levers)
    return plan if choice.candidates is None else choice.candidates.in_place_of_levers(plan)


def _items(plan: Plan, data: Path, out: Path, present: Sequence[str], choice: Choice) -> list[Item]:
    changes = tuple(choice.changes.items())
    if choice.has_levers:
        return ablation.lever_items(plan, data, out, present, changes)
    items = []
    for entry in plan.recordings:
        if entry.name in present:
            for seed in entry.seeds(plan.seeds):
                for independent, modes in ((False, entry.modes), (True, entry.independent)):
                    items += [Item(entry, m, seed, data, out, independent, "", changes) for m in modes]
    return items


def _compare_descriptors(
    plan: Plan, data: Path, out: Path, present: Sequence[str], choice: Choice
) -> list[Row]:
    """Every descriptor on pairs of views of every recording; the rows are done, whatever they hold."""
    kept = descriptors.Kept(out / DESCRIPTORS, data, plan.seeds[0], choice.again)
    rows, faults = descriptors.measure_all(plan, data, present, kept)
    return _tell(DESCRIPTORS, out, rows, faults, descriptors.page(rows, faults, command(choice)))


def _lose_sight(plan: Plan, data: Path, out: Path, present: Sequence[str], choice: Choice) -> list[Row]:
    """A second taken away at some places of every recording; the rows are done, whatever they hold."""
    rows, faults = blackout.measure_all(plan, data, out, present)
    return _tell(BLACKOUT, out, rows, faults, blackout.page(rows, faults, command(choice)))


def _tell(study: str, out: Path, rows: Sequence[Row], faults: Sequence[str], text: str) -> list[Row]:
    write_summary(out / f"{study}.json", {"version": version(), "faults": faults, "rows": rows})
    write_text(out / f"{study}.md", text)
    print("\n" + text)
    return [{**row, "status": "done"} for row in rows] + [{"status": "failed", "error": f} for f in faults]


class _Report:
    """Says each outcome as it comes in, and keeps the JSON up to date."""

    def __init__(self, plan: Plan, items: Sequence[Item], missing: Sequence[str], path: Path) -> None:
        self._plan, self._items, self._missing, self._path = plan, items, missing, path
        self._rows: dict[str, Row] = {}

    def told(self, item: Item, row: Row) -> None:
        self._rows[item.title] = row
        seconds = row.get("seconds")
        took = "" if seconds is None else f" ({seconds:.0f} s)"
        print(f"[{len(self._rows)}/{len(self._items)}] {item.title}: {outcome(row)}{took}", flush=True)
        if seconds is not None:
            self.write([self._rows[i.title] for i in self._items if i.title in self._rows])

    def medians(self, rows: Sequence[Row]) -> overall.Medians:
        """By recording and mode, of the runs with one error of T_CF a block."""
        return medians(self._plan, split(rows)[0])

    def write(self, rows: Sequence[Row]) -> None:
        """What was found of each recording and mode, by how much Cf helps, and every run, as JSON."""
        headline, independent = split(rows)
        write_summary(
            self._path,
            {
                "version": version(),
                "plan": self._plan.origin,
                "missing": list(self._missing),
                "complete": len(rows) == len(self._items),
                "recordings": medians(self._plan, headline),
                "differences": [asdict(d) for d in differences(self._plan, headline)],
                "rows": headline,
                "independent_rows": independent,
            },
        )


def failed(rows: Sequence[Row]) -> bool:
    """Whether any run failed."""
    names = [row for row in rows if row["status"] != "done"]
    if names:
        print(f"collabslam: {len(names)} of {len(rows)} runs failed; the page says why.", file=sys.stderr)
    return bool(names)
