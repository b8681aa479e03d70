"""The store of the queue: files, jobs, beds, and several processes that use them at once."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from time import time
from typing import NoReturn

import pytest
from queue_world import FACTS, PRINTERS, World

from printer_slicer.errors import OutputError, UsageError
from printer_slicer.print_queue import queue_store, supervisor
from printer_slicer.print_queue.queue_store import MAX_COPIES, PrintQueue
from printer_slicer.print_queue.records import JobRequest, QueueSnapshot, clean_name
from printer_slicer.print_queue.run_folder import try_to_claim
from printer_slicer.print_queue.supervisor import Supervisor, is_supervised, lock_queue
from tests.waiting import LAST_RESORT


@pytest.fixture
def queue(tmp_path: Path) -> Iterator[PrintQueue]:
    (tmp_path / "printers.toml").write_text(PRINTERS, encoding="utf-8")
    made = PrintQueue(tmp_path / "queue", tmp_path / "printers.toml", max_bytes=1000)
    yield made
    made.close()


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    made = World(tmp_path)
    yield made
    made.close()


def add(queue: PrintQueue, request: JobRequest | None = None) -> list[int]:
    file = queue.add_file("part.gcode", [b"G28\n"])
    queue.store_facts(file.id, FACTS)
    return [job.id for job in queue.add_jobs(file.id, request)]


def order(queue: PrintQueue) -> list[int]:
    return [job.id for job in queue.snapshot().jobs]


def test_content_is_stored_once_and_no_name_is_part_of_a_path(queue: PrintQueue) -> None:
    first = queue.add_file("../../etc/part.gcode", [b"G28\n", b"G1 X1\n"])
    second = queue.add_file("other.gcode", [b"G28\nG1 ", b"X1\n"])

    assert first.id == second.id
    assert (first.name, first.size) == ("part.gcode", 10)
    assert queue.list_files() == (second,)
    assert second.name == "other.gcode"
    assert queue.files.find_path(first.id).read_bytes() == b"G28\nG1 X1\n"
    stored = [path.name for path in queue.folder.rglob("*") if path.is_file() and "sqlite" not in path.name]
    assert stored == [first.id]


@pytest.mark.parametrize(
    ("name", "cleaned"),
    [
        ("a/b\\c.gcode", "c.gcode"),
        ("x\n\x1b[31m.gcode", "x[31m.gcode"),
        ("e\u202eedocg.exe", "eedocg.exe"),
        ("..", ".."),
        ("", "unnamed"),
        ("y" * 300, "y" * 200),
    ],
)
def test_names_from_outside_are_cleaned(name: str, cleaned: str) -> None:
    assert clean_name(name) == cleaned


def test_a_file_that_is_too_large_leaves_nothing(queue: PrintQueue) -> None:
    with pytest.raises(UsageError, match=r"larger than 0\.001 MB"):
        queue.add_file("part.gcode", [b"x" * 600, b"x" * 600])

    assert list((queue.folder / "files" / "incoming").iterdir()) == []


@pytest.mark.parametrize("file", ["../../../etc/passwd", "a" * 63, "A" * 64, ""])
def test_only_hashes_are_ids_of_files(queue: PrintQueue, file: str) -> None:
    with pytest.raises(UsageError):
        queue.files.find_path(file)
    with pytest.raises(UsageError):
        queue.add_jobs(file)


def test_jobs_keep_the_order_in_which_they_were_added_and_can_be_moved(queue: PrintQueue) -> None:
    one, two, three = add(queue, JobRequest(copies=3))
    (four,) = add(queue, JobRequest(first=True, held=True))
    assert order(queue) == [four, one, two, three]

    queue.move_job(three, before=one)
    assert order(queue) == [four, three, one, two]
    queue.move_job(four)
    assert order(queue) == [three, one, two, four]
    queue.move_job(one, before=one)
    assert order(queue) == [three, two, four, one]


def test_a_job_that_does_not_wait_has_no_place(queue: PrintQueue) -> None:
    one, two = add(queue, JobRequest(copies=2))
    queue.cancel_job(one)

    with pytest.raises(UsageError, match="job 1 is cancelled"):
        queue.move_job(two, before=one)
    with pytest.raises(UsageError, match="there is no job 77"):
        queue.move_job(77)


def test_invalid_requests_add_nothing(queue: PrintQueue) -> None:
    for request in (
        JobRequest(copies=0),
        JobRequest(copies=MAX_COPIES + 1),
        JobRequest(printer="middle"),
        JobRequest(allow=("no_such_finding",)),
    ):
        with pytest.raises(UsageError):
            add(queue, request)

    assert order(queue) == []


def test_an_ended_job_can_be_released_but_not_a_done_one(queue: PrintQueue) -> None:
    (job,) = add(queue)
    queue.cancel_job(job)
    queue.release_job(job)
    assert queue.find_job(job).state == "ready"

    queue.set_bed("left", "clear")
    assert queue.begin_run("run", job, "left")
    queue.end_run("run", "done", "")
    with pytest.raises(UsageError, match="job 1 is done and cannot become ready"):
        queue.release_job(job)


@pytest.mark.parametrize("bed", ["occupied", "unknown"])
def test_a_run_begins_on_a_clear_bed_only(queue: PrintQueue, bed: str) -> None:
    """Also where the bed was clear when the supervisor looked."""
    (job,) = add(queue)
    queue.set_bed("left", "occupied" if bed == "occupied" else "unknown")

    assert not queue.begin_run("run", job, "left")
    assert queue.find_job(job).state == "ready"
    assert queue.snapshot().runs == ()


def test_a_run_begins_with_a_ready_job_only(queue: PrintQueue) -> None:
    (job,) = add(queue, JobRequest(held=True))
    queue.set_bed("left", "clear")

    assert not queue.begin_run("run", job, "left")
    assert queue.snapshot().printers[0].bed == "clear"


def test_a_start_occupies_the_bed_and_every_end_leaves_it_so(queue: PrintQueue) -> None:
    for outcome in ("done", "failed", "cancelled", "rejected", "not_started", "lost"):
        (job,) = add(queue)
        queue.set_bed("left", "clear")
        assert queue.begin_run(outcome, job, "left")
        with pytest.raises(UsageError, match="printing job"):
            queue.set_bed("left", "clear")
        queue.end_run(outcome, outcome, "why")  # type: ignore[arg-type]

        state = queue.snapshot().printers[0]
        assert (state.bed, state.job, state.message) == ("occupied", None, f"job {job}: why")
        queue.set_bed("left", "clear")
        assert queue.snapshot().printers[0].message == ""


def test_a_second_end_of_a_run_changes_nothing(queue: PrintQueue) -> None:
    (job,) = add(queue)
    queue.set_bed("left", "clear")
    queue.begin_run("run", job, "left")
    queue.end_run("run", "done", "")

    queue.end_run("run", "failed", "again")
    queue.mark_printing("run")

    assert queue.find_job(job).state == "done"


def test_a_job_that_is_cancelled_before_its_print_began_does_not_wait_again(queue: PrintQueue) -> None:
    (job,) = add(queue)
    queue.set_bed("left", "clear")
    queue.begin_run("run", job, "left")

    assert queue.cancel_job(job).state == "starting"
    queue.end_run("run", "not_started", "the port cannot be opened")

    assert queue.find_job(job).state == "cancelled"


def test_a_process_that_has_not_locked_its_run_yet_is_waited_for(world: World) -> None:
    job = world.add("left")
    world.clear_bed("left")
    world.step()
    world.step()

    assert world.queue.find_job(job).state == "starting"
    assert try_to_claim(world.processes[0].folder)


def test_the_database_itself_allows_one_run_per_printer_and_job(queue: PrintQueue) -> None:
    one, two = add(queue, JobRequest(copies=2))
    queue.set_bed("left", "clear")
    queue.begin_run("run", one, "left")
    connection = sqlite3.connect(queue.folder / "queue.sqlite")
    insert = "INSERT INTO run (id, job, printer, started) VALUES (?, ?, ?, 0)"

    with pytest.raises(sqlite3.IntegrityError, match=r"run\.printer"):
        connection.execute(insert, ("second", two, "left"))
    with pytest.raises(sqlite3.IntegrityError, match=r"run\.job"):
        connection.execute(insert, ("third", one, "right"))
    connection.close()


def test_several_processes_and_threads_add_jobs_at_once(queue: PrintQueue, tmp_path: Path) -> None:
    others = [PrintQueue(tmp_path / "queue", tmp_path / "printers.toml") for _ in range(3)]
    threads = [
        Thread(target=lambda one=one: [add(one) for _ in range(10)]) for one in [queue, queue, *others]
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(LAST_RESORT)

    assert sorted(order(queue)) == order(queue) == list(range(1, 51))
    for one in others:
        one.close()


def test_a_change_by_another_process_is_noticed(queue: PrintQueue, tmp_path: Path) -> None:
    other = PrintQueue(tmp_path / "queue", tmp_path / "printers.toml")
    before = queue.snapshot().revision
    assert queue.wait_for_change(before, 0.0) == before

    thread = Thread(target=add, args=(other,))
    thread.start()
    assert queue.wait_for_change(before, LAST_RESORT) > before
    thread.join(LAST_RESORT)
    other.close()


def test_printers_are_read_again_when_their_file_changes(queue: PrintQueue, tmp_path: Path) -> None:
    assert [state.name for state in queue.snapshot().printers] == ["left", "right"]
    (tmp_path / "printers.toml").write_text(
        f'[new]\nport = "sim:"\nprofile = "x"\n{PRINTERS}', encoding="utf-8"
    )

    assert next((state.name, state.bed) for state in queue.snapshot().printers) == ("new", "unknown")


def test_a_material_can_be_loaded(queue: PrintQueue) -> None:
    queue.set_material("left", "petg")
    with pytest.raises(UsageError):
        queue.set_material("left", "no_such_material")
    with pytest.raises(UsageError, match="there is no printer middle"):
        queue.set_material("middle", "petg")

    assert [state.material for state in queue.snapshot().printers] == ["petg", "pla"]


def test_a_queue_of_a_newer_version_is_left_alone(queue: PrintQueue, tmp_path: Path) -> None:
    connection = sqlite3.connect(queue.folder / "queue.sqlite")
    connection.execute("PRAGMA user_version = 99")
    connection.close()

    with pytest.raises(OutputError, match="newer version"):
        PrintQueue(tmp_path / "queue", tmp_path / "printers.toml")


def test_a_file_that_is_no_database_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "queue.sqlite").write_bytes(b"This is not a database. " * 100)

    with pytest.raises(OutputError, match="cannot be opened"):
        PrintQueue(tmp_path, tmp_path / "printers.toml")


def test_two_supervisors_refuse_to_work_on_one_queue(queue: PrintQueue) -> None:
    assert not is_supervised(queue)
    with lock_queue(queue):
        assert is_supervised(queue)
        with pytest.raises(UsageError, match="another process runs the queue"), lock_queue(queue):
            pass
    assert not is_supervised(queue)


def test_errors_of_the_database_are_plain_and_leave_it_usable(queue: PrintQueue) -> None:
    (job,) = add(queue)
    connection = sqlite3.connect(queue.folder / "queue.sqlite")
    connection.execute("ALTER TABLE revision RENAME TO hidden")
    for call in (lambda: queue.hold_job(job), queue.snapshot):
        with pytest.raises(OutputError, match="the queue cannot be read or written"):
            call()
    connection.execute("ALTER TABLE hidden RENAME TO revision")
    connection.close()

    queue.hold_job(job)
    assert queue.find_job(job).state == "held"


def test_a_supervisor_tells_an_error_once_and_tries_again(queue: PrintQueue, tmp_path: Path) -> None:
    said: list[str] = []
    looks = iter(range(4))
    valid = (tmp_path / "printers.toml").read_text(encoding="utf-8")

    def stop() -> bool:
        """The file is invalid at first, and valid at the end."""
        look = next(looks)
        (tmp_path / "printers.toml").write_text("" if look < 2 else valid, encoding="utf-8")
        return look == 3

    Supervisor(queue, on_change=said.append).run(stop)

    assert len(said) == 1
    assert "there are no printers" in said[0]


def test_a_deleted_file_is_gone_until_it_is_added_again(queue: PrintQueue) -> None:
    (job,) = add(queue)
    (file,) = queue.list_files()
    with pytest.raises(UsageError, match=f"job {job} needs part.gcode"):
        queue.delete_file(file.id)
    queue.cancel_job(job)
    queue.delete_file(file.id)
    assert queue.list_files() == ()
    assert not queue.files.contains(file.id)
    assert queue.find_file(file.id) == file
    with pytest.raises(UsageError, match="was deleted"):
        queue.add_jobs(file.id)
    with pytest.raises(UsageError, match="was deleted"):
        queue.release_job(job)
    add(queue)
    queue.release_job(job)
    assert [one.id for one in queue.list_files()] == [file.id]


def test_folders_of_old_runs_are_deleted_and_their_history_stays(
    queue: PrintQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = queue.add_file("part.gcode", [b"G28"])
    for run, printer in (("old", "left"), ("new", "left"), ("running", "right")):
        monkeypatch.setattr(queue_store, "time", lambda run=run: 0.0 if run != "new" else time())
        (job,) = queue.add_jobs(file.id)
        queue.set_bed(printer, "clear")
        queue.find_run_folder(run).mkdir(parents=True)
        assert queue.begin_run(run, job.id, printer)
        if run != "running":
            queue.end_run(run, "done", "")
    Supervisor(queue).recover()
    assert {path.name for path in queue.find_run_folder("").iterdir()} == {"new", "running"}
    assert queue.list_run_ids() == {"old", "new", "running"}


def test_a_printer_may_be_removed_between_two_looks(
    queue: PrintQueue, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (job,) = add(queue)
    for printer in queue.snapshot().printers:
        queue.set_bed(printer.name, "clear")
    take_snapshot = queue.snapshot

    def take_and_remove() -> QueueSnapshot:
        snapshot = take_snapshot()
        (tmp_path / "printers.toml").write_text('[other]\nport = "sim:"\nprofile = "marlin_220"\n')
        return snapshot

    monkeypatch.setattr(queue, "snapshot", take_and_remove)
    Supervisor(queue).step()
    assert queue.find_job(job).state == "ready"


def test_a_job_starts_once_the_profile_of_its_printer_can_be_read(
    queue: PrintQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    (job,) = add(queue)
    name = queue.snapshot().printers[0].name
    queue.set_bed(name, "clear")
    read, launched = supervisor.read_traits, list[Path]()

    def fail(*_: object) -> NoReturn:
        raise UsageError("the profile is being written", remedy="")

    def launch(folder: Path) -> NoReturn:
        launched.append(folder)
        raise OSError

    starter = Supervisor(queue, launch=launch)
    monkeypatch.setattr(supervisor, "read_traits", fail)
    starter.step()
    assert not launched
    monkeypatch.setattr(supervisor, "read_traits", read)
    starter.step()
    assert len(launched) == 1
    assert queue.find_job(job).state == "starting"
