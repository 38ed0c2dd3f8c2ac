"""A film as one HTML file: its pictures, a slider and a button; it asks nothing of any server.

matplotlib's own player links a style sheet on another machine and draws the ids of its parts at
random; this one does neither, so that the same pictures give the same bytes.
"""

import io
from base64 import b64encode
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from string import Template

import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from PIL import Image

DPI = 110  # of a picture: text of 7 points is 11 pixels high
COLOURS = 128  # of a picture, which makes it a quarter as large

PLAYER = Template("""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>$title</title>
<meta name="viewport" content="width=device-width">
<style>
body { margin: 0 auto; max-width: $width; font: 16px sans-serif; background: #fff; color: #111 }
img { width: 100%; background: #fff } p { margin: 0.5em }
.controls { display: flex; gap: 0.6em; padding: 0.5em } input { flex: 1; min-width: 3em }
@media (prefers-color-scheme: dark) { body { background: #121212; color: #eee } }
</style></head><body><main>
<h1 style="font-size: 1em; margin: 0.5em">$title</h1>
<img id="picture" alt="$alt" src="$first">
<div class="controls"><button id="play">Play</button>
<input id="at" type="range" min="0" max="$last" value="0" aria-label="$slider"></div>
<p id="caption" aria-live="polite">$caption</p></main>
<script>
const frames = [$frames], captions = [$captions];
const at = document.getElementById("at"), play = document.getElementById("play");
let clock = 0;
function show() {
  document.getElementById("picture").src = frames[at.value];
  document.getElementById("caption").textContent = captions[at.value];
  at.setAttribute("aria-valuetext", captions[at.value]);
}
function stop() { clearInterval(clock); clock = 0; play.textContent = "Play"; }
function next() {
  at.value = (Number(at.value) + 1) % frames.length;
  show();
  if (Number(at.value) === frames.length - 1) stop();
}
at.oninput = () => { stop(); show(); };
play.onclick = () => {
  if (clock) return stop();
  play.textContent = "Stop";
  clock = setInterval(next, 400);
};
show();
</script></body></html>
""")


@dataclass(frozen=True)
class Film:
    """Pictures that follow each other.

    Attributes
    ----------
    title : what it is called
    alt : what it shows and what to notice
    slider : what the slider moves along
    pictures : each with its caption; they are drawn when the film is written
    """

    title: str
    alt: str
    slider: str
    pictures: Iterable[tuple[str, Figure]]


def player(film: Film) -> str:
    """The page that plays a film; closes its figures.

    Raises
    ------
    ValueError : no picture
    """
    drawn = [(escape(text), _embedded(fig), fig.get_figwidth()) for text, fig in film.pictures]
    if not drawn:
        raise ValueError("a film needs pictures")
    captions, frames, widths = zip(*drawn, strict=True)
    return PLAYER.substitute(
        title=escape(film.title), alt=escape(film.alt), slider=escape(film.slider),
        last=len(drawn) - 1,
        width=f"{1.4 * max(widths):.1f}in", first=frames[0], caption=captions[0],
        frames=", ".join(f'"{frame}"' for frame in frames),
        captions=", ".join(f'"{caption}"' for caption in captions),
    )  # fmt: skip


def _embedded(fig: Figure) -> str:
    """A figure as an address that holds the whole picture."""
    drawn, small = io.BytesIO(), io.BytesIO()
    fig.savefig(drawn, dpi=DPI)
    plt.close(fig)
    few = Image.open(drawn).convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=0)
    few.save(small, "PNG", optimize=True)
    return f"data:image/png;base64,{b64encode(small.getvalue()).decode()}"
