"""Settings of planning: the search for the best parse tree, the choice of a cutting plane, the end of a trial."""

from pydantic.dataclasses import dataclass

from cutgrammar.settings.bounds import CHECKED, Count, Few, Flag, Natural, NonNegative, Positive, Share


@dataclass(frozen=True, config=CHECKED)
class SearchSettings:
    """Inference of the best parse tree (III-A, III-B).

    Attributes:
        n_searches: independent searches, of which the best result is taken; any number of planner actors shares them.
        max_rounds: maximum number of rollouts of each search.
        n_starts: draws of the current fragments' types for each search, the expansions of v_S.
        min_type_probability: a type that is less probable for a current fragment counts as impossible.
        exploration: weight of the exploration term of UCT.
        score_range: range of log posteriors below the best over which UCT distinguishes scores [nats]; 0 for all that
            were seen.
        swaps_per_terminal: annealing swaps per terminal and rollout.
        layout_length_scale: distance over which a fragment becomes e times less likely in Eq. (7), relative to the cube
            root of the current fragments' total volume, which cutting does not change.
        divide_by_type_prior: whether Eq. (5) is read as p(c|z)/p(c); False takes it as printed.
    """

    n_searches: Few = 4
    max_rounds: Count = 50
    n_starts: Count = 8
    min_type_probability: Share = 1e-6
    exploration: NonNegative = 0.2
    score_range: NonNegative = 0.0
    swaps_per_terminal: Natural = 20
    layout_length_scale: Positive = 1.0
    divide_by_type_prior: Flag = True


@dataclass(frozen=True, config=CHECKED)
class PlusSettings:
    """What `grammar-plus` adds to the paper's posterior and choice of planes; `grammar` reads none of it.

    Attributes:
        volume_weight: factor of log p(volume | type) of every node with grounded terminals; 0 leaves it out.
        conservation: standard deviation of the log ratio of a current fragment's volume to the summed volume of its
            terminals; 0 leaves the term out.
        whole: whether the choice between terminal and production has a probability.
        scattered_layout: whether the layout term counts even where the goal's fragments lie apart.
        swap_types: whether the annealing also swaps the fragments of terminals of different types.
        assign_objects: whether each search first assigns the goal's fragments to the current ones, and then searches
            the parse tree of each current fragment by itself.
        marginal: temperature [nats] at which the kept parse trees vote for the production of the fragment to cut; 0
            takes that of the best tree.
        score_range: replaces `search.score_range`.
        keep_plan: whether what is left of the last step's parse tree competes with the trees found anew.
        best_first: whether of all fragments to cut the one with the best plane is cut; otherwise one is drawn.
        virtual_slicing: whether planes are scored by slicing virtually and comparing with the grounded goals.
        union_shapes: whether a product that is cut further is compared with the union of the goal's fragments that lie
            together; otherwise with the spreads of its type.
        adjust_offset: whether a drawn plane is first moved along its normal until the volumes fit.
        adjust_tilt: whether the best of them is then tilted where that improves its score.
        fit_weight: weight of the goal's fit against the density of the drawn planes [nats].
        spread_weight: weight of the fit of products that are cut further to the spreads of their types.
        n_trees: distinct parse trees kept by each search.
    """

    volume_weight: NonNegative = 1.0
    conservation: NonNegative = 0.1
    whole: Flag = True
    scattered_layout: Flag = False
    swap_types: Flag = True
    assign_objects: Flag = True
    marginal: NonNegative = 1.0
    score_range: NonNegative = 0.0
    keep_plan: Flag = True
    best_first: Flag = False
    virtual_slicing: Flag = True
    union_shapes: Flag = True
    adjust_offset: Flag = True
    adjust_tilt: Flag = False
    fit_weight: NonNegative = 20.0
    spread_weight: NonNegative = 0.5
    n_trees: Count = 50


@dataclass(frozen=True, config=CHECKED)
class CuttingSettings:
    """From a mixture over cutting planes to one plane (III-C); the same for every method that has a mixture.

    Attributes:
        n_draws: planes drawn from the mixture, of which the one with the most neighbours is cut; every refusal in a
            step halves them.
    """

    n_draws: Count = 64


@dataclass(frozen=True, config=CHECKED)
class TrialSettings:
    """How a trial ends.

    Attributes:
        max_refusals: refused cuts in one step after which the trial ends as stuck.
        max_seconds: a trial that runs for longer is stopped, tried once more on a new worker, and then ends as
            `timeout` [s]. It changes no trial that ends in time.
    """

    max_refusals: Count = 10
    max_seconds: Positive = 3600.0
