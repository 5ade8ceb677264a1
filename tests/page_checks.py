"""Checks of self-contained pages in a browser: nothing is cut off in narrow and wide windows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Page, expect

from waiting import wait_for

WIDTHS = "[...document.querySelectorAll('.uplot canvas')].map(canvas => canvas.width)"
"""Widths of the canvases of all plots, as JavaScript."""

NOTE_TEXTS = """{ const texts = new Map(), to = CanvasRenderingContext2D.prototype;
    const {fillText, clearRect} = to;
    to.clearRect = function (...box) { texts.set(this.canvas, []); clearRect.apply(this, box); };
    to.fillText = function (text, x, y, most = Infinity) {
        const m = this.measureText(text), narrow = Math.min(1, most / m.width);
        const [left, right] = [m.actualBoundingBoxLeft, m.actualBoundingBoxRight];
        const ends = [[x - narrow * left, y - m.actualBoundingBoxAscent],
                      [x + narrow * right, y + m.actualBoundingBoxDescent]]
            .map(([x, y]) => this.getTransform().transformPoint({x, y}));
        const [[x0, x1], [y0, y1]] = ["x", "y"].map(k => ends.map(p => p[k]).sort((a, b) => a - b));
        if (!texts.has(this.canvas)) texts.set(this.canvas, []);
        texts.get(this.canvas).push([text, x0, x1, y0, y1]);
        fillText.call(this, text, x, y, ...(most < Infinity ? [most] : []));
    };
    window.readTexts = () => [...texts].filter(([canvas]) => canvas.isConnected)
        .map(([canvas, all]) => [canvas.width, canvas.height, all]); }"""
"""Keeps every text that a canvas shows, with the pixels that it covers."""


def list_cut(page: Page) -> list[Any]:
    """Return the texts in canvases that leave their canvas."""
    return [
        text
        for width, height, texts in page.evaluate("readTexts()")
        for text in texts
        if text[1] < 0 or text[2] > width or text[3] < 0 or text[4] > height
    ]


def check_nothing_is_cut(page: Page, has_plots: bool) -> None:
    """Check that no element and no text of a plot exceeds its box."""
    wait_for(lambda: page.evaluate("document.documentElement.scrollWidth <= innerWidth"))
    wide = page.locator("header *, main *").evaluate_all("""all => all.filter(e =>
        !e.closest(".uplot, #labels") && e.scrollWidth > e.clientWidth + 1
        && getComputedStyle(e).overflowX !== "visible").map(e => e.outerHTML.slice(0, 200))""")
    assert wide == []
    assert has_plots == (page.evaluate("readTexts()") != [])
    assert list_cut(page) == []
    for picture in page.locator("figure.live img").all():
        expect(picture).to_be_hidden()


def check_badges(page: Page) -> None:
    """Check that the text of every badge contrasts with its background (WCAG 2: 4.5 to 1)."""
    contrasts = page.locator(".badge").evaluate_all("""all => all.map(e => {
        const {color, backgroundColor} = getComputedStyle(e);
        const [a, b] = [color, backgroundColor].map(text => {
            const [r, g, b] = text.match(/[0-9.]+/g).map(v => v / 255)
                .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
            return 0.2126 * r + 0.7152 * g + 0.0722 * b + 0.05;
        });
        return [e.className, Math.max(a, b) / Math.min(a, b)]; })""")
    assert contrasts
    assert all(contrast > 4.5 for _, contrast in contrasts), contrasts


def widen(page: Page, *, has_plots: bool) -> None:
    """Widen a page that was loaded in a narrow window; its plots are drawn anew."""
    narrow = page.evaluate(WIDTHS)
    assert (narrow != []) == has_plots
    page.set_viewport_size({"width": 1280, "height": 900})
    wait_for(lambda: page.evaluate("innerWidth") == 1280)
    wait_for(lambda: all(np.subtract(page.evaluate(WIDTHS), narrow) > 0))
    check_nothing_is_cut(page, has_plots=has_plots)


def check_page(show_page: Callable[..., Page], path: Path, *, has_plots: bool) -> Page:
    """Nothing is cut off at 800 and at 1280 px, and the contents lead to headings."""
    page = show_page(path, 800)
    check_nothing_is_cut(page, has_plots=has_plots)
    if page.locator(".badge").count():
        check_badges(page)
    inside = page.locator("nav a")
    assert inside.count() > 2
    assert inside.evaluate_all("all => all.every(a => document.querySelector(a.hash) !== null)")
    widen(page, has_plots=has_plots)
    return page
