"use strict";
/* Pictures of a page as uPlot charts: zoom by dragging, values under the cursor, curves switched on and off by name.
   Without this script, and in print, the page shows the static pictures. */
const INCH = 112;  // pixels of the page per inch of the picture
const NEAR = 40;  // largest distance [pixels] from the cursor of a point whose coordinates are shown
const MOST_READ = 14;  // most values shown under the cursor
const BLUE = "#0072b2";  // the only colour of pictures that is too dark for a dark page

/** The values of a column that was packed by plotting/thinning.py: decimals and differences, or numbers if `log`. */
function unpacked(packed, log) {
    if (log) return packed;
    const unit = 10 ** -packed[0];
    let sum = 0;
    return packed.slice(1).map(step => step === null ? null : (sum += step) * unit);
}

/** A number as text, with at most five digits. */
function shown(value) {
    if (!Number.isFinite(value)) return "–";
    const size = Math.abs(value), plain = !size || size >= 1e-4 && size < 1e5;
    return (plain ? String(Number(value.toPrecision(5))) : value.toExponential(3)).replace("-", "−");
}

/** A colour of a picture, with the blue of the page: for a canvas, and for a style, where blue is opaque. */
const tint = color => color ? color.replace(BLUE, css("--blue")) : ink();
const styled = color => !color ? "var(--text)" : color.startsWith(BLUE) ? "var(--blue)" : color;

const inside = (at, min, max) => at >= min - 1e-3 * Math.abs(min) && at <= max + 1e-3 * Math.abs(max);
const ascending = ([from, to]) => from < to ? [from, to] : [to, from];

/** The ticks of a logarithmic axis: 1, 2, 5 of each decade, or 1 alone over more than 2.5 decades. */
function decades(min, max) {
    const marks = [], digits = Math.log10(max / min) > 2.5 ? [1] : [1, 2, 5];
    for (let power = Math.floor(Math.log10(min)); power <= Math.log10(max); ++power) {
        marks.push(...digits.map(digit => Number(`${digit}e${power}`)).filter(at => inside(at, min, max)));
    }
    return marks.length > 1 ? marks : even(min, max);
}

/** Ticks at even steps. */
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

/** The interpolated value of a curve at a position along x, as text; null beyond its ends. */
function interpolated({x, y}, at, {log, range}) {
    const high = x.findIndex(value => value !== null && value > at), low = (high < 0 ? x.length : high) - 1;
    if (low < 0 || x[low] === null) return null;
    if (high < 0) return x[low] === at ? shown(y[low]) : null;
    const value = y[low] + (at - x[low]) / (x[high] - x[low]) * (y[high] - y[low]);
    if (log) return shown(value);
    const digits = 4 - Math.floor(Math.log10(Math.abs(range[1] - range[0]) || 1));
    return shown(Number(value.toFixed(Math.min(Math.max(digits, 0), 12))));
}

/** The coordinates, as text, of the point nearest to the cursor; null if none is near. */
function nearest(u, {x, y}, left, top) {
    let best = NEAR, label = null;
    x.forEach((at, i) => {
        if (at === null || y[i] === null) return;
        const away = Math.hypot(u.valToPos(at, "x") - left, u.valToPos(y[i], "y") - top);
        if (away < best) [best, label] = [away, `${shown(at)}, ${shown(y[i])}`];
    });
    return label;
}

/** A function that builds a line's path [pixels of the canvas], with a dot at each point if it has markers. */
function path({width, marker = 0, hollow}) {
    return (u, k) => {
        const [xs, ys] = u.data[k], stroke = new Path2D(), fill = new Path2D(), dots = hollow ? stroke : fill;
        const radius = marker / 2 * devicePixelRatio;
        let down = false;
        xs.forEach((at, i) => {
            const known = at !== null && ys[i] !== null;
            const x = known && u.valToPos(at, "x", true), y = known && u.valToPos(ys[i], "y", true);
            if (known && width) stroke[down ? "lineTo" : "moveTo"](x, y);
            down = known;
            if (!known || !marker) return;
            dots.moveTo(x + radius, y);
            dots.arc(x, y, radius, 0, 2 * Math.PI);
        });
        return {stroke, fill: marker && !hollow ? fill : null, clip: null, flags: 3};
    };
}

class Panel {
    constructor(chart, data) {
        Object.assign(this, {chart, data, x: ascending(data.x.range), y: ascending(data.y.range)});
        for (const each of [...data.lines, ...data.areas]) {
            each.x = unpacked(each.x, data.x.log);
            each.y = unpacked(each.y, data.y.log);
        }
        this.box = element("div", {class: "panel", role: "img"});
        this.read = element("div", {class: "read", hidden: ""});
        if (data.title) this.box.append(element("div", {class: "name"}, data.title));
    }

    words() {
        const names = [...new Set(this.data.lines.map(line => line.name).filter(Boolean))].join(", ");
        const axes = `${this.data.y.label || "curve"} against ${this.bottom}`;
        return [this.data.title, axes, names].filter(Boolean).join("; ");
    }

    /** The label of the horizontal axis: this panel's, or that of the last panel that shares the axis. */
    get bottom() {
        const {label, group} = this.data.x, axes = this.chart.panels.map(({data}) => data.x);
        return label || axes.findLast(x => x.group === group && x.label)?.label || "";
    }

    axis(which) {
        const {label, ticks, words, log} = this.data[which];
        const names = new Map(ticks?.[0].map((at, k) => [at, ticks[1][k]]));
        const fixed = (min, max) => {
            const marks = ticks[0].filter(at => inside(at, min, max));
            return words || marks.length > 1 ? marks : even(min, max);
        };
        const marks = ticks ? fixed : log ? decades : undefined;
        return {
            ...AXIS, label: label || undefined, labelSize: 20, gap: 4,
            ...(which === "x" ? {side: 2, size: 30, space: 56} :
                {side: 3, size: this.chart.room(this.data.place[1]), space: 26}),
            values: (u, splits) => splits.map(at => at === null ? "" : names.get(at) ?? shownTick(at, log)),
            ...(marks && {splits: (u, k, min, max) => marks(min, max), filter: (u, splits) => splits}),
        };
    }

    /** Width [pixels] of the vertical axis, by its longest number or word. */
    get wide() {
        const words = this.data.y.ticks?.[1] ?? this.data.y.range.map(shown);
        return Math.min(22 + 7.5 * Math.max(4, ...words.map(text => text.length)), 150);
    }

    /** Creates the plot in the available width. */
    show() {
        const {data, chart} = this, lines = data.lines.length ? data.lines : [{x: [], y: []}];
        const scale = which => ({auto: false, range: () => this[which], distr: data[which].log ? 3 : 1,
            dir: data[which].range[0] > data[which].range[1] ? -1 : 1});
        this.plot = new uPlot({
            mode: 2, ...this.size, legend: {show: false}, padding: [8, 22, 0, 0],  // half of a last number
            cursor: {
                points: {show: false}, dataIdx: () => null, focus: {prox: -1},
                drag: {x: true, y: true, uni: 30, setScale: false},
                bind: {dblclick: () => () => chart.whole()},
                sync: {key: `${chart.key}-${data.x.group}`, scales: ["x", null]},
            },
            scales: {x: {time: false, ...scale("x")}, y: scale("y")},
            axes: [this.axis("x"), this.axis("y")],
            series: [null, ...lines.map(line => ({
                label: line.name, show: !chart.off.has(line.name), paths: path(line), points: {show: false},
                dash: line.dash, stroke: () => tint(line.color), fill: () => tint(line.color),
                width: line.width || (line.hollow ? 1 : 0.01),
                facets: ["x", "y"].map(which => ({scale: which, auto: false})),
            }))],
            hooks: {drawAxes: [u => paint(u, (...of) => this.under(...of), true)],
                draw: [u => paint(u, (...of) => this.over(...of))],
                setCursor: [u => this.tell(u)], setSelect: [u => this.select(u)]},
        }, [null, ...lines.map(({x, y}) => [x, y])], this.box);
        this.box.append(this.read);
    }

    get size() {
        const height = Math.round(Math.max(this.data.height * INCH, 120)) + (this.data.x.label ? 20 : 0);
        return {width: Math.max(this.box.clientWidth, 200), height};
    }

    resize() {
        const {size, plot} = this;
        if (plot && (size.width !== plot.width || size.height !== plot.height)) plot.setSize(size);
    }

    /** Paints bands, areas and levels below the curves. */
    under(ctx, x, y, frame) {
        const {left, top, width, height} = frame, {bands, areas, levels} = this.data;
        const on = ({name}) => !this.chart.off.has(name);
        for (const {color, axis, ranges} of bands.filter(on)) {
            ctx.fillStyle = tint(color);
            for (const [from, to] of ranges) {
                if (axis === "x") ctx.fillRect(x(from), top, x(to) - x(from), height);
                else ctx.fillRect(left, y(from), width, y(to) - y(from));
            }
        }
        for (const area of areas) {
            ctx.fillStyle = tint(area.color);
            ctx.beginPath();
            area.x.forEach((at, i) => ctx.lineTo(x(at), y(area.y[i])));
            ctx.fill();
        }
        for (const {axis, at, color, width: thick, dash} of levels.filter(on)) {
            pen(ctx, tint(color), thick, dash);
            across(ctx, axis, axis === "x" ? x(at) : y(at), frame);
        }
    }

    /** Paints texts above the curves. */
    over(ctx, x, y, {left, top, width, height}) {
        ctx.font = SMALL();
        for (const {text, at, share, align, base, color} of this.data.texts) {
            const right = at ? x(at[0]) : left + share[0] * width, down = at ? y(at[1]) : top + (1 - share[1]) * height;
            if (right < left || right > left + width || down < top || down > top + height) continue;
            ctx.fillStyle = tint(color);
            ctx.textAlign = align;
            ctx.textBaseline = {top: "top", center: "middle", center_baseline: "middle"}[base] ?? "alphabetic";
            ctx.fillText(text, right, down - (base === "bottom" ? 3 * devicePixelRatio : 0));
        }
    }

    select(u) {
        const {left, top, width, height} = u.select, {x, y} = this.data;
        if (width < 4 && height < 4) return;
        if (width >= 4 && (width < u.over.clientWidth || height === u.over.clientHeight)) {
            this.chart.zoom("x", x.group, [u.posToVal(left, "x"), u.posToVal(left + width, "x")]);
        }
        if (height >= 4 && height < u.over.clientHeight) {
            this.chart.zoom("y", y.group, [u.posToVal(top + height, "y"), u.posToVal(top, "y")]);
        }
        u.setSelect({left: 0, top: 0, width: 0, height: 0}, false);
    }

    to(which, range) {
        const [min, max] = this[which] = ascending(range);
        this.plot.setScale(which, {min, max});
    }

    /** Shows each curve's value at the cursor; for dots, and a curve along which x falls, the nearest point. */
    tell(u) {
        const {left, top, event} = u.cursor, {lines, y} = this.data;
        this.read.hidden = !(left >= 0 && event && u.over.contains(event.target));
        if (this.read.hidden) return;
        const at = u.posToVal(left, "x"), unit = /\[(.*)\]/.exec(this.bottom)?.[1] ?? "";
        const rows = lines.filter((_, k) => u.series[k + 1].show).map(line =>
            [line, line.loop || !line.width ? nearest(u, line, left, top) : interpolated(line, at, y)]);
        const values = rows.filter(([, value]) => value !== null).slice(0, MOST_READ).map(([{color, name}, value]) =>
            element("div", {}, element("i", {style: `background:${styled(color)}`}),
                `${name || y.label.replace(/ *\[.*/, "") || "value"} `, element("b", {}, value)));
        this.read.replaceChildren(element("div", {class: "at"}, `${shown(at)} ${unit}`), ...values);
        this.read.hidden = !values.length;
        const gap = left > u.over.clientWidth / 2 ? -14 - this.read.offsetWidth : 14;
        this.read.style.left = `${Math.max(0, u.over.offsetLeft + left + gap)}px`;
        this.read.style.top = `${u.root.offsetTop + 8}px`;
    }
}

/** A figure of the page: its panels, arranged as in the picture. */
class Chart {
    constructor(figure, key) {
        const {panels, names} = JSON.parse(figure.querySelector("script").textContent);
        Object.assign(this, {key, off: new Set()});
        this.panels = panels.map(panel => new Panel(this, panel));
        this.panels.forEach(panel => panel.box.setAttribute("aria-label", panel.words()));
        const label = figure.querySelector("svg").getAttribute("aria-label");
        this.reset = element("button", {type: "button", class: "reset", hidden: ""}, "whole range");
        this.reset.addEventListener("click", () => this.whole());
        const box = element("div", {class: "live", role: "group", "aria-label": label}, this.legend(names), this.grid);
        figure.querySelector(".still").after(box);
        figure.classList.add("is-live");
        this.panels.forEach(panel => panel.show());
        new ResizeObserver(() => this.panels.forEach(panel => panel.resize())).observe(box);
    }

    get grid() {
        const rows = [];
        for (const {box, data: {place: [row], share}} of this.panels) {
            rows[row] ??= element("div", {class: "row"});
            box.style.flex = `${share} 1 0`;
            rows[row].append(box);
        }
        return element("div", {class: "panels"}, ...rows.filter(Boolean));
    }

    /** Buttons that switch curves, levels and bands on and off, in the order of the picture's legend. */
    legend(order) {
        const every = this.panels.flatMap(({data}) => [...data.lines, ...data.levels, ...data.bands]);
        const names = every.map(({name}) => name).filter(Boolean);
        const buttons = [...new Set([...order.filter(name => names.includes(name)), ...names])].map(name => {
            const {color, width, dash, ranges} = every.find(each => each.name === name);
            const thick = Math.min(Math.max(width || 2, 1.5), 4);
            const look = ranges ? "band" : !width ? "dot" : dash ? "dashed" : "";
            const swatch = element("i", {class: look, style: `--swatch:${styled(color)};--thick:${thick}px`});
            const button = element("button", {type: "button", "aria-pressed": "true"}, swatch, name);
            button.addEventListener("click", () => this.toggle(name, button));
            return button;
        });
        return element("div", {class: "toggles", role: "group", "aria-label": "curves"}, ...buttons, this.reset);
    }

    toggle(name, button) {
        const show = this.off.delete(name);
        if (!show) this.off.add(name);
        button.setAttribute("aria-pressed", String(show));
        for (const {plot, data} of this.panels) {
            data.lines.forEach((line, k) => { if (line.name === name) plot.setSeries(k + 1, {show}); });
            plot.redraw(false, true);
        }
    }

    zoom(which, group, range) {
        for (const panel of this.panels) if (panel.data[which].group === group) panel.to(which, range);
        this.reset.hidden = false;
    }

    whole() {
        for (const panel of this.panels) for (const which of ["x", "y"]) panel.to(which, panel.data[which].range);
        this.reset.hidden = true;
    }

    /** Width [pixels] of the vertical axes in a column of panels: that of the widest. */
    room(column) {
        return Math.max(...this.panels.filter(({data}) => data.place[1] === column).map(panel => panel.wide));
    }
}

const charts = [], waiting = new IntersectionObserver(entries => {
    for (const {target} of entries.filter(entry => entry.isIntersecting)) {
        waiting.unobserve(target);
        charts.push(new Chart(target, `figure-${charts.length}`));
    }
}, {rootMargin: "400px"});
document.querySelectorAll("figure.curves").forEach(figure => waiting.observe(figure));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () =>
    charts.forEach(chart => chart.panels.forEach(({plot}) => plot.redraw(false, true))));
