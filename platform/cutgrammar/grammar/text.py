"""A grammar as readable text."""

from cutgrammar.grammar.production import Grammar


def describe(grammar: Grammar) -> str:
    """One block of lines per type: its share of the training fragments and its productions by descending probability.

    Example:
        >>> from cutgrammar.grammar.production import Production
        >>> print(describe(Grammar(2, {Production(0, (0, 1)): 0.75, Production(0, (1, 1)): 0.25}, (0.4, 0.6))))
        2 fragment types, 2 productions; v_S produces the current fragments
        c0  (40 %)  -> c0 c1  .75
                     | c1 c1  .25
        c1  (60 %)  never cut
    """
    rows: list[tuple[str, str]] = []
    for c in range(grammar.k):
        head = f"c{c}".ljust(len(str(grammar.k)) + 2) + f"({100 * grammar.frequencies[c]:.0f} %)".rjust(7)
        options = sorted(grammar.options.get(c, ()), key=lambda option: (-grammar.probabilities[option], option))
        for i, option in enumerate(options):
            right = " ".join(f"c{child}" for child in option.children)
            share = f"{grammar.probabilities[option]:.2f}"
            rows.append(
                (f"{head}  -> {right}" if i == 0 else " " * len(head) + f"   | {right}", share.removeprefix("0"))
            )
        if not options:
            rows.append((f"{head}  never cut", ""))
    width = max((len(left) for left, share in rows if share), default=0)
    title = f"{_count(grammar.k, 'fragment type')}, {_count(len(grammar.probabilities), 'production')}"
    lines = [f"{left.ljust(width)}  {share}" if share else left for left, share in rows]
    return "\n".join([f"{title}; v_S produces the current fragments", *lines])


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")
