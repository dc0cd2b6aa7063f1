"""Starting plans of `guided` from a grammar: the best parse trees of a search, each with planes for its productions.

The search is that of `grammar-plus`. A parse tree is carried out in thought: every production draws a plane from the
plane network for the fragment that it divides, the plane is shifted until the sides have the volumes of the goal's
fragments grounded below its children, and the fragment is sliced. The classifier says which product is which child. A
production with more than two children is divided one child at a time by the same plane's normal.

For the study of what the grammar is worth there are two more sources: the same productions with equal probabilities,
where types of fragments are not told apart and volumes of types are not used, and a grammar whose children's types are
permuted. Where a grammar derives no tree at all, plans are halved as by the source `halve`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from cutgrammar.fitting.carry_over import pruned
from cutgrammar.fitting.plan_tree import Branch, Leaf, PlanTree, goals_of
from cutgrammar.fitting.starting_plans import halving_plans
from cutgrammar.fitting.targets import Targets
from cutgrammar.fitting.workpiece import Workpiece
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame
from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar.geometry.partial_volume import height_of_volume
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Sliced, slice_mesh
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.parse_tree import TERMINAL
from cutgrammar.inference.posterior import UNGROUNDED
from cutgrammar.inference.problem import Problem, shape_likelihood
from cutgrammar.inference.reachable import derivations
from cutgrammar.inference.search import GroundedTree, best_of
from cutgrammar.inference.start import max_terminals, possible_types, target_terminals
from cutgrammar.interfaces import ParallelMap
from cutgrammar.methods.grammar_plus import Additions
from cutgrammar.settings import Settings

if TYPE_CHECKING:
    from cutgrammar.learning.model import Model

MIN_SHARE = 1e-3
"""A product with less of its fragment's volume is not divided further in thought."""
SHUFFLE_SEED = 0
"""Seed of the permutation of types of the shuffled grammar."""


def uniform(grammar: Grammar) -> Grammar:
    """The grammar with the same productions, all of one parent equally probable."""
    return replace(grammar, probabilities={p: 1.0 / len(grammar.options[p.parent]) for p in grammar.probabilities})


def shuffled(grammar: Grammar, seed: int = SHUFFLE_SEED) -> Grammar:
    """The grammar with the types of all children permuted, so that what follows from what is lost."""
    order = np.random.default_rng(seed).permutation(grammar.k).tolist()
    changed = {
        Production(p.parent, tuple(order[c] for c in p.children)): share for p, share in grammar.probabilities.items()
    }
    return replace(grammar, probabilities=dict(sorted(changed.items())))


class GrammarPlans:
    """A source of starting plans (`StartingPlans`) from the model's grammar, or a changed one."""

    def __init__(
        self,
        model: "Model",
        settings: Settings,
        parallel_map: ParallelMap,
        kind: Literal["grammar", "uniform", "shuffled"],
    ) -> None:
        self._model = model
        self._settings = settings
        self._parallel_map = parallel_map
        self._informed = kind != "uniform"
        changes: dict[str, Callable[[Grammar], Grammar]] = {"uniform": uniform, "shuffled": shuffled}
        self._grammar = changes[kind](model.grammar) if kind in changes else model.grammar

    def __call__(
        self,
        now: Configuration,
        goal: Configuration,
        pieces: Sequence[Workpiece],
        targets: Targets,
        n: int,
        rng: np.random.Generator,
    ) -> list[tuple[PlanTree, ...]]:
        """Plans of the best distinct parse trees (see `StartingPlans`)."""
        settings = replace(
            self._settings,
            search=replace(self._settings.search, score_range=self._settings.plus.score_range),
            plus=replace(self._settings.plus, n_trees=max(n, self._settings.plus.n_trees)),
        )
        additions = Additions(self._model, settings)
        problem = self._problem(now, goal, additions)
        known = derivations(problem.grammar, max_terminals(problem))
        possible = possible_types(problem, settings.search.min_type_probability)
        if target_terminals(problem, known, possible) is None:
            return halving_plans(now, goal, pieces, targets, n, rng)
        keys = [int(key) for key in rng.integers(0, 2**63, size=settings.search.n_searches)]
        result = best_of(self._parallel_map(partial(additions.search, problem, settings=settings.search), keys))
        found = result.trees[:n] or (GroundedTree(result.tree, result.grounding, result.posterior.log),)
        meshes = [piece.solid.moved(piece.X_FC.inverse()) for piece in pieces]
        return [
            _completed(
                [
                    self._carried_out(_Reading.of(tree, known.productions), int(root), mesh, targets.volumes, rng)
                    for root, mesh in zip(tree.tree.roots, meshes, strict=True)
                ],
                pieces,
                targets,
            )
            for tree in found
        ]

    def _problem(self, now: Configuration, goal: Configuration, additions: Additions) -> Problem:
        k, search = self._grammar.k, self._settings.search
        attributes = additions.attributes(now, goal)
        if self._informed:
            classifier = self._model.classifier
            z_now, z_goal = (np.array([self._model.features(f.shape) for f in each]) for each in (now, goal))
            log_current = classifier.log_probabilities(z_now)
            log_goal = shape_likelihood(
                classifier.log_probabilities(z_goal), self._model.grammar, search.divide_by_type_prior
            )
        else:
            log_current, log_goal = np.full((len(now), k), -np.log(k)), np.zeros((len(goal), k))
            attributes = replace(attributes, volume_weight=0.0, log_whole=None)
        return Problem(
            grammar=self._grammar,
            log_current=log_current,
            log_goal=log_goal,
            p_WG=np.array([fragment.p_WC for fragment in goal]),
            layout_length_scale=search.layout_length_scale
            * sum(fragment.shape.volume for fragment in now) ** (1.0 / 3.0),
            attributes=attributes,
        )

    def _carried_out(
        self, reading: "_Reading", node: int, mesh: Mesh | None, volumes: Floats, rng: np.random.Generator
    ) -> PlanTree | None:
        """The plan of a node whose fragment is `mesh`, in the frame C of the object; None if nothing is grounded."""
        production = reading.production(node)
        if production is None:
            goal = reading.goal(node)
            return None if goal is None else Leaf(goal)
        children = [child for child in reading.children(node) if reading.goals(child)]
        if len(children) < 2:
            return self._carried_out(reading, children[0], mesh, volumes, rng) if children else None
        normal = None
        if mesh is not None:
            z = self._model.features(mesh)
            plane_P = self._model.planes.sample(production, z, rng, self._settings.cutting.n_draws)
            normal = plane_P.transformed(canonical_frame(mesh)).normal
        wanted = [float(volumes[reading.goals(child)].sum()) for child in children]
        first, rest = children[0], children[1:]
        below, above, first_below = self._sides(mesh, normal, reading, children, wanted, rng)
        own, others = (below, above) if first_below else (above, below)
        one = self._carried_out(reading, first, own, volumes, rng)
        if len(rest) == 1:
            other = self._carried_out(reading, rest[0], others, volumes, rng)
        else:
            subplans = [self._carried_out(reading, child, None, volumes, rng) for child in rest]
            other = _in_a_row([plan for plan in subplans if plan is not None], normal)
        if one is None or other is None:
            return one or other
        return Branch(one, other, normal) if first_below else Branch(other, one, normal)

    def _sides(
        self,
        mesh: Mesh | None,
        normal: Floats | None,
        reading: "_Reading",
        children: Sequence[int],
        wanted: Sequence[float],
        rng: np.random.Generator,
    ) -> tuple[Mesh | None, Mesh | None, bool]:
        """The products below and above a plane, and whether the first child is the one below."""
        options = []
        for first_below in (True, False):
            sides = _sliced(mesh, normal, wanted[0] / sum(wanted), first_below)
            score = float(rng.random()) * 1e-6
            if sides is not None and self._informed and len(children) == 2:
                order = children if first_below else children[::-1]
                z = np.array([self._model.features(side) for side in sides])
                log_types = self._model.classifier.log_probabilities(z)
                score += float(sum(row[reading.types[child]] for row, child in zip(log_types, order, strict=True)))
            options.append((score, first_below, sides))
        _, first_below, sides = max(options, key=lambda option: option[0])
        return (*sides, first_below) if sides is not None else (None, None, first_below)


@dataclass(frozen=True, eq=False)
class _Reading:
    """A grounded parse tree, read node by node."""

    types: list[int]
    numbers: list[int]
    below: list[list[int]]
    grounded: dict[int, int]
    productions: Sequence[Production]

    @staticmethod
    def of(found: GroundedTree, productions: Sequence[Production]) -> "_Reading":
        tree = found.tree
        below: list[list[int]] = [[] for _ in tree.types]
        for node, parent in enumerate(tree.parents.tolist()):
            if parent >= 0:
                below[parent].append(node)
        grounded = {
            node: goal
            for node, goal in zip(tree.terminals.tolist(), found.grounding.tolist(), strict=True)
            if goal != UNGROUNDED
        }
        return _Reading(tree.types.tolist(), tree.productions.tolist(), below, grounded, productions)

    def production(self, node: int) -> Production | None:
        return None if self.numbers[node] == TERMINAL else self.productions[self.numbers[node]]

    def children(self, node: int) -> list[int]:
        return self.below[node]

    def goal(self, node: int) -> int | None:
        return self.grounded.get(node)

    def goals(self, node: int) -> list[int]:
        if not self.below[node]:
            return [self.grounded[node]] if node in self.grounded else []
        return [goal for child in self.below[node] for goal in self.goals(child)]


def _in_a_row(plans: Sequence[PlanTree], normal: Floats | None) -> PlanTree | None:
    """Plans side by side along one normal."""
    if not plans:
        return None
    return plans[0] if len(plans) == 1 else Branch(plans[0], _in_a_row(plans[1:], normal) or plans[1], normal)


def _sliced(mesh: Mesh | None, normal: Floats | None, share: float, first_below: bool) -> tuple[Mesh, Mesh] | None:
    """The largest product on either side of the plane across `normal` that leaves `share` of the volume on one side."""
    if mesh is None or normal is None:
        return None
    other = np.eye(3)[int(np.argmin(np.abs(normal)))]
    x = np.cross(other, normal)
    x /= np.linalg.norm(x)
    X_PC = Pose(np.array([x, np.cross(normal, x), normal]), np.zeros(3))
    part = share if first_below else 1.0 - share
    height = height_of_volume(np.ascontiguousarray(mesh.moved(X_PC).triangles), 2, part * mesh.volume)
    sliced = slice_mesh(mesh, Plane(normal, -height), MIN_SHARE)
    return (sliced.below[0], sliced.above[0]) if isinstance(sliced, Sliced) else None


def _completed(trees: Sequence[PlanTree | None], pieces: Sequence[Workpiece], targets: Targets) -> tuple[PlanTree, ...]:
    """The trees with every goal fragment at exactly one leaf, and at least one for each current fragment."""
    plans = list(trees)
    missing = sorted(set(range(len(targets.volumes))) - {goal for tree in plans if tree for goal in goals_of(tree)})
    for i in [i for i, tree in enumerate(plans) if tree is None]:
        if not missing:
            donor = max((j for j, tree in enumerate(plans) if tree), key=lambda j: len(goals_of(_known(plans[j]))))
            goals = goals_of(_known(plans[donor]))
            missing = [goals[-1]]
            plans[donor] = pruned(_known(plans[donor]), goals[-1])
        plans[i] = Leaf(missing.pop())
    for goal in missing:
        left = [piece.volume - targets.volumes[goals_of(_known(plans[i]))].sum() for i, piece in enumerate(pieces)]
        roomiest = int(np.argmax(left))
        plans[roomiest] = Branch(_known(plans[roomiest]), Leaf(goal))
    return tuple(_known(tree) for tree in plans)


def _known(tree: PlanTree | None) -> PlanTree:
    assert tree is not None
    return tree
