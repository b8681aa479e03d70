"""Any order of events, and kills between any two steps: no part is printed onto another, no job twice or never."""

from __future__ import annotations

from collections.abc import Iterator
from shutil import rmtree

import pytest
from hypothesis import HealthCheck, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule, run_state_machine_as_test
from queue_world import World, make_folder

from printer_slicer.errors import UsageError
from tests.effort import examples, few_of

PRINTER = st.sampled_from(["left", "right"])
NTH = st.integers(0, 5)


class QueueMachine(RuleBasedStateMachine):
    """Persons, supervisors and prints do what they like, and each of them may be killed anywhere."""

    def __init__(self) -> None:
        super().__init__()
        self._folder = make_folder()
        self.world = World(self._folder)

    def teardown(self) -> None:
        """In the end every job that is not held is printed, once everybody does their work."""
        try:
            finish(self.world)
        finally:
            self.world.close()
            rmtree(self._folder, ignore_errors=True)

    def job(self, nth: int) -> int:
        jobs = [*self.world.waiting(), *self.world.queue.list_ended_jobs(3)]
        return jobs[nth % len(jobs)].id if jobs else 0

    @rule(printer=st.sampled_from(["", "left", "both"]), held=st.booleans(), first=st.booleans())
    def add(self, printer: str, held: bool, first: bool) -> None:
        self.world.add(printer, held=held, first=first)

    @rule(printer=PRINTER)
    def clear_bed(self, printer: str) -> None:
        self.world.clear_bed(printer)

    @rule(nth=NTH, what=st.sampled_from(["hold", "cancel", "move", "last"]), other=NTH)
    def change(self, nth: int, what: str, other: int) -> None:
        job, queue = self.job(nth), self.world.queue
        try:
            if what == "hold":
                queue.hold_job(job)
            elif what == "cancel":
                queue.cancel_job(job)
            else:
                queue.move_job(job, self.job(other) if what == "move" else None)
        except UsageError:
            pass

    @rule(nth=NTH)
    def release(self, nth: int) -> None:
        if job := self.job(nth):
            self.world.release(job)

    @rule(kill_after=st.sampled_from([-1, -1, *range(12)]))
    def step(self, kill_after: int) -> None:
        self.world.step(kill_after)

    @rule()
    def restart(self) -> None:
        self.world.restart()

    @precondition(lambda self: self.world.processes)
    @rule(nth=NTH, outcome=st.sampled_from(["done", "done", "failed"]), times=st.integers(1, 5))
    def advance(self, nth: int, outcome: str, times: int) -> None:
        process = self.world.processes[nth % len(self.world.processes)]
        for _ in range(times):
            if process.poll() is None:
                process.advance("done" if outcome == "done" else "failed")

    @precondition(lambda self: self.world.processes)
    @rule(nth=NTH)
    def die(self, nth: int) -> None:
        self.world.processes[nth % len(self.world.processes)].die()


def finish(world: World) -> None:
    """Let everybody do their work until nothing is left to do; fails if a job is lost."""
    for _ in range(1000):
        if not [job for job in world.waiting() if job.state != "held"]:
            return
        for printer in ("left", "right"):
            world.clear_bed(printer)
        world.step()
        for process in list(world.processes):
            process.advance("done")
    raise AssertionError(f"never printed: {world.waiting()}")


@pytest.mark.hypothesis
@pytest.mark.parametrize("part", few_of(range(20), 1))
def test_no_order_of_events_prints_onto_a_part_or_a_job_twice_or_never(part: int) -> None:
    """10 000 random orders in `just thorough`."""
    run_state_machine_as_test(
        seed(part)(QueueMachine),
        settings=settings(
            max_examples=examples(100, 500),
            stateful_step_count=30,
            deadline=None,
            suppress_health_check=list(HealthCheck),
        ),
    )


@pytest.fixture
def world() -> Iterator[World]:
    folder = make_folder()
    made = World(folder)
    yield made
    made.close()
    rmtree(folder, ignore_errors=True)


@pytest.mark.parametrize("kill_after", range(16))
@pytest.mark.parametrize("advances", range(6))
def test_a_supervisor_may_be_killed_between_any_two_steps(
    world: World, kill_after: int, advances: int
) -> None:
    jobs = [world.add("left"), world.add("left")]
    world.clear_bed("left")

    world.step(kill_after)
    for process in list(world.processes):
        for _ in range(advances):
            if process.poll() is None:
                process.advance("done")
    world.step(kill_after)
    world.step()
    finish(world)

    assert [world.queue.find_job(job).state for job in jobs] == ["done", "done"]
    assert [world.prints[job] for job in jobs] == [1, 1]
