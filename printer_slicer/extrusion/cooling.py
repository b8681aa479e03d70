"""Slow down layers that print too fast to cool, hidden extrusions first, and set the fan.

A layer that only supports have counts as a part of the layer before it, because both cool until the next layer of the
part begins. So do layers of different objects that overlap in z: one cools while the other is printed.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, SmallInt
from printer_slicer.extrusion.extrusion_values import SUPPORT_RATIOS
from printer_slicer.extrusion.timing import move_seconds, retime_moves
from printer_slicer.model import Event, Fan, Program
from printer_slicer.profile import Material, Profile
from printer_slicer.roles import ROLES, Role, roles_with
from printer_slicer.values import replace

__all__ = ["fan_events", "find_next_extrusions", "slow_small_layers"]

_MAX_ROUNDS = 30  # maximum number of rounds; lower speeds hardly slow down short moves
_ENOUGH_RATIO = 0.995  # fraction of the minimum layer time that is sufficient
_MOVES_AT_ONCE: Final = 1 << 16  # bounds the memory for intermediate values
_SAME_HEIGHT: Final = 1e-6  # mm, for rounding of heights
_FAN_STEP = 0.05  # smaller changes of the fan are not written
# Hidden extrusions are slowed down first; bridges and overhangs last.
_SLOWING_ROUND: Final = np.array([row.slowed_in for row in ROLES], np.int8)


def slow_small_layers(program: Program, profile: Profile, relative_speed: Float) -> Program:
    """Slow down extrusions on layers that print too fast to cool.

    A path that follows a surface is slowed down as a whole, until its fastest extrusion has the minimum speed, so that
    its flow stays even. `relative_speed` (K,) is the speed in relation to that extrusion; empty: 1 for all moves.
    """
    material = profile.material
    if not material.min_layer_time:
        return program
    motion = program.speed, move_seconds(program, profile)
    # The lower bound must not make slower moves faster, such as those of the first layer.
    least = material.min_speed * relative_speed if len(relative_speed) else material.min_speed
    floor = np.minimum(program.speed, least)
    extrudes, slowed_in = program.role != Role.TRAVEL, _SLOWING_ROUND[program.role]
    group = _group_layers(program)
    for last in range(int(_SLOWING_ROUND.max()) + 1):
        motion = _slow_down(
            program, group, motion, floor, may_slow=extrudes & (slowed_in <= last), profile=profile
        )
    return program if motion[0] is program.speed else replace(program, speed=motion[0])


def _group_layers(program: Program) -> Int:
    """Return for each layer (L,) the first layer of the group with which it cools.

    A layer joins the group before it if only supports have it, or if nothing in it lies on a layer of that group, as
    with layers of different objects.
    """
    n_layers = program.plan.n_layers
    carries = roles_with(is_support=True)[program.role]
    others = (program.role != Role.TRAVEL) & ~carries
    supports, rest = (np.bincount(program.layer[some], minlength=n_layers) for some in (carries, others))
    joins = (supports > 0) & (rest == 0)
    if program.plan.has_overlaps:
        joins |= _find_parallel_layers(program, others, joins)
    return np.asarray(np.maximum.accumulate(np.where(joins, 0, np.arange(n_layers))))


def _find_parallel_layers(program: Program, others: Bool, joins: Bool) -> Bool:
    """Return a mask (L,) of the layers that lie on no layer of the group before them.

    Args:
        program: the moves.
        others: (K,) mask of the extrusions that are not supports.
        joins: (L,) mask of the layers of supports alone.
    """
    plan = program.plan
    bottom = np.full(plan.n_layers, -np.inf)
    np.maximum.at(bottom, program.layer[others], program.z_top[others] - program.height[others])
    found = np.zeros(plan.n_layers, np.bool_)
    lowest_top = -np.inf  # of the layers in the group so far
    for layer in np.flatnonzero(~joins).tolist():
        found[layer] = bottom[layer] < lowest_top - _SAME_HEIGHT
        lowest_top = lowest_top if found[layer] else float(plan.top[layer])
    return found


def _slow_down(
    program: Program,
    group: Int,
    motion: tuple[Float, Float],
    floor: Float,
    *,
    may_slow: Bool,
    profile: Profile,
) -> tuple[Float, Float]:
    """Slow down moves that `may_slow` (K,) on layers that print too fast; return speeds, mm/s, and times (K,), s.

    `group` (L,) has the layer with which each one cools.
    """
    speed, seconds = motion
    least, layer = profile.material.min_layer_time, group[program.layer]
    here = slice(None)  # only moves of layers that may be too short
    for _ in range(_MAX_ROUNDS):
        before, able = speed[here], may_slow[here]
        total = np.bincount(layer[here], weights=seconds[here])
        slowable = np.bincount(layer[here], weights=seconds[here] * able)
        room = least - (total - slowable)
        short = (total < least * _ENOUGH_RATIO) & (slowable > 0)
        if not short.any():
            break
        factor = np.where(short, slowable / np.maximum(room, 1e-9), 1.0)[layer[here]]
        slower = np.where(able & (factor < 1), np.maximum(before * factor, floor[here]), before)
        if not (slower < before * _ENOUGH_RATIO).any():  # layers still too short are at their lowest speed
            break
        changed_layers = program.layer[here][slower < before][[0, -1]]
        speed = speed.copy()
        speed[here] = slower
        seconds = retime_moves(program, seconds, speed, changed_layers, profile)
        # Slower moves never take less time, so no other layer becomes too short.
        here = slice(*np.searchsorted(layer, np.flatnonzero(short)[[0, -1]] + [0, 1]).tolist())
    return speed, seconds


def fan_events(program: Program, support_ratio: Float, profile: Profile) -> list[Event]:
    """Return fan changes: faster on short layers, ramped up over height, full on bridges, in between on overhangs.

    Support interfaces have a fan speed of their own. `support_ratio` (K,) is the fraction of each extrusion's width
    that rests on the layer below.
    """
    of_layer, is_fan_allowed = _fan_ratios_of_layers(program, profile)
    # Batches of moves, from the last to the first: each needs the first extrusion after it.
    steps, following = np.zeros(program.n_moves, np.int64), program.n_moves
    for first in reversed(range(0, program.n_moves, _MOVES_AT_ONCE)):
        some = slice(first, first + _MOVES_AT_ONCE)
        extrusion = find_next_extrusions(program.role[some], first, following)
        following = int(extrusion[0])
        exists, at = extrusion < program.n_moves, np.minimum(extrusion, program.n_moves - 1)
        role = np.where(exists, program.role[at], np.int16(Role.TRAVEL))
        ratio = of_layer[program.layer[some]]
        own = _fan_ratios(ratio, role, np.where(exists, support_ratio[at], 1.0), profile.material)
        steps[some] = np.round(np.where(is_fan_allowed[program.layer[some]], own, ratio) / _FAN_STEP)
    change = np.flatnonzero(np.diff(steps, prepend=0) != 0)
    ratios = np.clip(steps[change] * _FAN_STEP, 0, 1)
    return [Fan(move, share) for move, share in zip(change.tolist(), ratios.tolist(), strict=True)]


def _fan_ratios_of_layers(program: Program, profile: Profile) -> tuple[Float, Bool]:
    """Return the fan ratio (L,) of each layer from its time and height, and whether (L,) the fan may be on."""
    material, plan = profile.material, program.plan
    group = _group_layers(program)
    seconds = np.bincount(
        group[program.layer], weights=move_seconds(program, profile), minlength=plan.n_layers
    )[group]
    span = max(material.fan_layer_time - material.min_layer_time, 1e-9)
    hurry = np.clip((material.fan_layer_time - seconds) / span, 0, 1)
    strongest = max(material.fan_ratio, material.fan_ratio_max)
    by_time = material.fan_ratio + hurry * (strongest - material.fan_ratio)
    ramp_height = max(material.fan_full_above - material.fan_off_below, 1e-9)
    ramp = np.clip((plan.top - material.fan_off_below) / ramp_height, 0, 1)
    return by_time * ramp, ramp > 0


def _fan_ratios(ratio: Float, role: SmallInt, support_ratio: Float, material: Material) -> Float:
    """Return the fan ratio (n,) of moves on layers where the fan may be on.

    Args:
        ratio: (n,) that of the layer.
        role: (n,) role of the next extrusion; TRAVEL if there is none.
        support_ratio: (n,) its support ratio.
        material: sets the ratios of bridges, overhangs and support interfaces.
    """
    on_bridges = np.maximum(ratio, material.fan_ratio_bridge)
    toward = np.interp(support_ratio, SUPPORT_RATIOS, _overhang_fan_weights(material))
    is_bridge = roles_with(is_bridge=True)[role]
    ratio = np.where(is_bridge, on_bridges, ratio + toward * (on_bridges - ratio))
    return np.where(role == Role.SUPPORT_INTERFACE, material.support_fan, ratio)


def _overhang_fan_weights(material: Material) -> tuple[float, ...]:
    """Return for each support ratio in `SUPPORT_RATIOS` the weight of the bridge fan speed."""
    return (
        material.fan_overhang_0_ratio,
        material.fan_overhang_25_ratio,
        material.fan_overhang_50_ratio,
        material.fan_overhang_75_ratio,
        0.0,
    )


def find_next_extrusions(role: SmallInt, first: int, following: int) -> Int:
    """Return the index (n,) of the extrusion that follows each move; for an extrusion, its own index.

    Args:
        role: (n,) role of each move.
        first: index of the first move.
        following: index of the next extrusion after the last move.
    """
    own = np.where(role != Role.TRAVEL, np.arange(first, first + len(role)), following)
    return np.asarray(np.minimum.accumulate(own[::-1])[::-1])
