"""Draws the JSON of `latency`: how often each duration is exceeded, and the wake-ups second by second.

Usage: python3 tools/latency/plot.py latency.json latency.png (needs matplotlib)
"""
import json
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def main(source, target):
    with open(source, encoding="utf-8") as file:
        run = json.load(file)
    figure, axes = plt.subplot_mosaic([["hops", "compared"], ["seconds", "seconds"]], figsize=(16, 12), layout="constrained")
    for name, row in run["hops_us"].items():
        axes["hops"].step(*zip(*row["tail"]), where="post", label=name.replace("_", " "))
    reference = run["reference"]
    compared = {f"{hop.replace('_', ' ')}, {kind}": rows[hop] for kind, rows in
                [("events", run["hops_us"]), ("polled", run["polled"]["hops_us"])]
                for hop in ["skeleton_to_command", "target_to_command"]}
    compared |= {"wake-up of retarget": run["wake_up_us"]["retarget"], "wake-up of own probe": reference["probe"]}
    if "cyclictest" in reference:
        compared["wake-up of cyclictest"] = reference["cyclictest"]
    for name, row in compared.items():
        axes["compared"].step(*zip(*row["tail"]), where="post", label=name)
    for panel in ["hops", "compared"]:
        axes[panel].set(xscale="log", yscale="log", ylim=(1e-6, 1), xlabel="us", ylabel="share of durations beyond")
    for name, row in [("retarget, events", run["wake_up_us"]["retarget"]),
                      ("retarget, polled", run["polled"]["wake_up_us"]["retarget"]), ("own probe", reference["probe"])]:
        at_s, p50, p99, most = zip(*row["seconds"])
        line, = axes["seconds"].plot(at_s, p50, linewidth=2, label=name)
        axes["seconds"].plot(at_s, p99, linewidth=0.7, color=line.get_color())
        axes["seconds"].plot(at_s, most, ".", markersize=3, color=line.get_color())
    axes["seconds"].set(yscale="log", xlabel="s", ylabel="wake-up, us: p50 (thick), p99 (thin), maximum (dots)")
    for panel in axes.values():
        panel.legend(fontsize="small")
        panel.grid(alpha=0.3)
    figure.savefig(target, dpi=100)


if __name__ == "__main__":
    main(*sys.argv[1:])
