from cutgrammar_dashboards.figures.anytime_picture import AnytimeCurve, AnytimePanel, draw_anytime
from cutgrammar_dashboards.figures.layout.sheet import write_sheet


def curve(name, level):
    budgets = (120.0, 1200.0, 12000.0)
    scores = tuple(level + 0.1 * i for i in range(3))
    return AnytimeCurve(name, budgets, scores, tuple((s - 0.05, s + 0.05) for s in scores))


def test_anytime_curves_share_axes_and_a_budget_without_an_interval_has_a_dot_only(tmp_path):
    lone = AnytimeCurve("halve", (120.0,), (0.4,), (None,))
    panels = [
        [AnytimePanel("in place", "n = 9", (curve("grammar", 0.6), lone)), AnytimePanel("foreign", "n = 0", ())],
        [AnytimePanel("in place", "n = 3", (curve("grammar", 0.3),))],
    ]
    figure = draw_anytime(panels, "Title", "subtitle", "evaluations", "strict IoU")
    charts = [axes for axes in figure.axes if axes.get_xscale() == "log"]
    assert len(charts) == 3
    assert len({axes.get_ylim() for axes in charts}) == 1
    assert len(charts[0].lines) == 2 + 3
    write_sheet(figure, tmp_path / "a.svg")
    assert (tmp_path / "a.svg").stat().st_size > 1000
