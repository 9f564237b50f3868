"""`graphrl report`: one page about a run; see `requests.Report`."""

from typing import Any

from graphrl_jax import runtime
from graphrl_jax.cli.repeat import repeating
from graphrl_jax.cli.requests import Report
from graphrl_jax.experiment.report.content import content_of
from graphrl_jax.experiment.report.facts import read_facts
from graphrl_jax.viz.run_page import run_page


def run(request: Report) -> dict[str, Any]:
    """Carries the request out."""
    runtime.configure()
    out = request.out or request.run / "report.html"
    if out.suffix != ".html" or out.is_dir():
        raise ValueError(f"--out is {out}; allowed: a file whose name ends in .html")
    facts = read_facts(request.run)
    command, note = repeating(facts.settings, facts.command, f"runs/{request.run.resolve().name}_again")
    content = content_of(facts, command, note)
    run_page(out, content)
    return {"out": str(out), "missed": list(content.missed)}
