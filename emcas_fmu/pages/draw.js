"use strict";
/* Functions of every page with plots by uPlot: elements, the page's colours, and painting on a plot. */
const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const ink = () => css("--text"), faint = () => css("--line");
const FONT = "12px system-ui, sans-serif", SMALL = () => `${11 * devicePixelRatio}px system-ui, sans-serif`;

const AXIS = {stroke: ink, font: FONT, labelFont: FONT, labelGap: 0, grid: {stroke: faint, width: 0.5},
    ticks: {stroke: faint, width: 0.5, size: 4}};

/** Sets attributes of an element of a page or drawing, and appends children; returns the element. */
function set(made, attributes, ...children) {
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    made.append(...children);
    return made;
}

const element = (tag, attributes = {}, ...children) => set(document.createElement(tag), attributes, ...children);

/** Paints on a plot: `paints` receives the canvas context, functions from values to positions along x and y, and the
    frame; `within` clips at the frame. */
function paint(u, paints, within = false) {
    const {ctx, bbox} = u, {left, top, width, height} = bbox;
    ctx.save();
    ctx.setLineDash([]);  // otherwise those of the last curve
    ctx.beginPath();
    if (within) {
        ctx.rect(left, top, width, height);
        ctx.clip();
        ctx.beginPath();
    }
    paints(ctx, x => u.valToPos(x, "x", true), y => u.valToPos(y, "y", true), bbox);
    ctx.restore();
}

/** Sets the colour, and thickness and dashes [pixels of the page] of lines. */
function pen(ctx, color, thick, dash = []) {
    Object.assign(ctx, {strokeStyle: color, fillStyle: color, lineWidth: thick * devicePixelRatio});
    ctx.setLineDash(dash.map(length => length * devicePixelRatio));
}

/** Strokes a line across a plot's frame, at a position [pixels of the canvas] along x or y. */
function across(ctx, axis, at, {left, top, width, height}) {
    ctx.beginPath();
    ctx.moveTo(axis === "x" ? at : left, axis === "x" ? top : at);
    ctx.lineTo(axis === "x" ? at : left + width, axis === "x" ? top + height : at);
    ctx.stroke();
}
