"""Run a study end to end: evaluate, analyse, write the tables and pictures, say what they mean."""

from __future__ import annotations

import csv
import io
import json
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np

from jointscope import __version__
from jointscope.atomic import write_text
from jointscope.experiments import first_screens
from jointscope.experiments.charts.files import write_files
from jointscope.experiments.markdown_report import write_markdown_report
from jointscope.experiments.provenance import provenance_section
from jointscope.experiments.sensitivity import analysis, figures
from jointscope.experiments.sensitivity.evaluate import evaluate_sample
from jointscope.experiments.sensitivity.study import OUTPUTS, Study, read_study
from jointscope.models.paper import paper_rig


def _csv(indices: tuple[analysis.Index, ...]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(asdict(indices[0])), lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(index) for index in indices)
    return text.getvalue()


def _page(study: Study, indices: tuple[analysis.Index, ...], spread: dict[str, tuple[float, float, float]]) -> str:
    lines = [
        f"# Sensitivity: {study.method}, {study.engine}, {len(study.factors)} parameters",
        "",
        "| output | 5 % | median | 95 % | what it means |",
        "|---|---|---|---|---|",
    ]
    for output in study.outputs:
        low, middle, high = spread[output]
        lines.append(
            f"| {output.replace('_', ' ')} [{OUTPUTS[output]}] | {low:.4g} | {middle:.4g} | {high:.4g} "
            f"| {analysis.sentence(study, indices, output)} |"
        )
    lines += [
        "",
        "![sensitivities](sensitivity.png)",
        "",
        "![FRF bands](frf-bands.png)",
        "",
        "![cost](heat-map.png)",
        "",
    ]
    if study.method == "sobol":
        lines.append(
            "Sobol estimates scatter around the truth: a small negative index means zero within its interval."
        )
    return "\n".join(lines) + "\n"


def run_study(path: Path, out: Path, *, workers: int, scheduler: str | None, as_json: bool) -> int:
    """Evaluate, analyse and draw ``path`` into ``out``; returns the exit code."""
    study = read_study(path, paper_rig().joint)
    sample = analysis.draw(study)
    began = time.monotonic()
    if scheduler == "local":
        from jointscope.experiments.sensitivity.cluster import local_cluster

        with local_cluster(workers) as address:
            table = evaluate_sample(study, sample, out / "blocks", scheduler=address)
    else:
        table = evaluate_sample(study, sample, out / "blocks", workers=workers, scheduler=scheduler)
    seconds = time.monotonic() - began
    indices = analysis.analyse(study, sample, table)
    low, middle, high = np.quantile(table, (0.05, 0.5, 0.95), axis=0)
    spread = {
        name: (float(low[column]), float(middle[column]), float(high[column]))
        for column, name in enumerate(OUTPUTS)
    }
    result = {
        "format": "jointscope-sensitivity-result/1",
        "version": __version__,
        "study": asdict(study),
        "evaluations": len(sample),
        "indices": [asdict(index) for index in indices],
        "quantiles": {name: dict(zip(("q05", "q50", "q95"), spread[name], strict=True)) for name in study.outputs},
        "sentences": {name: analysis.sentence(study, indices, name) for name in study.outputs},
    }
    write_text(out / "sensitivity.json", json.dumps(result, indent=1) + "\n")
    write_text(out / "sensitivity.csv", _csv(indices))
    figures.bars(study, indices, out / "sensitivity.png")
    frf = figures.frf_chart(study)
    write_files(frf, out)
    figures.heat_map(study, out / "heat-map.png")
    page = _page(study, indices, spread)
    write_text(out / "README.md", page)
    words = f"jointscope sensitivity {path.name} --out {out.resolve().name}"
    source = provenance_section(path, words, seed=study.seed)
    write_markdown_report(out / "README.md", first_screens.sensitivity(result), source, {"frf-bands.png": frf})
    print(json.dumps(result, indent=1) if as_json else page)
    if not as_json:
        print(f"{len(sample)} evaluations in {seconds:.1f} s; pictures in {out}")
    return 0
