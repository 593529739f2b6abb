"use strict";
/* Values of curves: unpacked, as text, as ticks of an axis, and those nearest to the cursor. */
const NEAR = 40;  // pixels from a loop within which its value is shown

/** Return the values of a packed column: its decimals and differences, or, along a logarithmic axis, the numbers. */
function unpacked(packed, log) {
    if (log) return packed;
    const unit = 10 ** -packed[0];
    let sum = 0;
    return packed.slice(1).map(step => step === null ? null : (sum += step) * unit);
}

/** Return a number for people: at most five digits. */
function shown(value) {
    if (!Number.isFinite(value)) return "–";
    const text = Math.abs(value) >= 1e5 || (value && Math.abs(value) < 1e-4) ? value.toExponential(3) : String(Number(value.toPrecision(5)));
    return text.replace("-", "−");
}

/** Return the ticks of a zoomed logarithmic axis: 1, 2, 5 of each decade. */
function decades(min, max) {
    const marks = [];
    for (let power = Math.floor(Math.log10(min)); power <= Math.log10(max); ++power) {
        for (const digit of Math.log10(max / min) > 2.5 ? [1] : [1, 2, 5]) {
            const at = Number((digit * 10 ** power).toPrecision(6));
            if (at >= min * 0.999 && at <= max * 1.001) marks.push(at);
        }
    }
    return marks.length > 1 ? marks : even(min, max);
}

/** Return ticks at even steps. */
function even(min, max) {
    const rough = (max - min) / 5, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map(times => times * power).find(size => size >= rough), marks = [];
    for (let at = Math.ceil(min / step); at * step <= max; ++at) marks.push(Number((at * step).toPrecision(10)));
    return marks;
}

function shownTick(value, log) {
    if (log && value && (value >= 1e5 || value < 1e-3)) return value.toExponential(0).replace("e+", "e");
    return String(Number(value.toPrecision(8))).replace("-", "−");
}

/** Return the interpolated value of a curve at a position along x; null beyond its ends. */
function between(line, at, data) {
    const {x, y} = line;
    let low = 0, high = x.length - 1;
    if (!x.length || at < x[0] || at > x[high]) return null;
    while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (x[middle] === null || x[middle] <= at) low = middle; else high = middle;
    }
    if (x[low] === null || x[high] === null) return null;
    const share = x[high] > x[low] ? (at - x[low]) / (x[high] - x[low]) : 0;
    const places = data.y.log ? 0 : Math.max(0, 4 - Math.floor(Math.log10(Math.abs(data.y.range[1] - data.y.range[0]) || 1)));
    const value = y[low] + share * (y[high] - y[low]);
    return shown(data.y.log ? value : Number(value.toFixed(Math.min(places, 12))));
}

function nearest(u, line, left, top) {
    let best = NEAR, label = null;
    for (let i = 0; i < line.x.length; ++i) {
        if (line.x[i] === null || line.y[i] === null) continue;
        const away = Math.hypot(u.valToPos(line.x[i], "x") - left, u.valToPos(line.y[i], "y") - top);
        if (away < best) [best, label] = [away, `${shown(line.x[i])}, ${shown(line.y[i])}`];
    }
    return label;
}
