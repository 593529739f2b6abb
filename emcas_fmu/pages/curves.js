"use strict";
/* Pictures of a page as uPlot charts: zoom by dragging, values under the cursor, curves switched on and off by name.
   Without this script, and in print, the page shows its pictures. */
const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const ink = () => css("--text"), faint = () => css("--line");
const INCH = 112;  // pixels of an inch of the picture
const FONT = "12px 'DejaVu Sans', Verdana, system-ui, sans-serif";

function element(tag, attributes = {}, ...children) {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    made.append(...children);
    return made;
}

/** Return a builder of the path through a line's points, in pixels of the canvas, with dots where it has markers. */
function drawn(line) {
    return (u, k) => {
        const [xs, ys] = u.data[k], stroke = new Path2D(), marks = new Path2D(), radius = (line.marker ?? 0) / 2 * devicePixelRatio;
        let down = false;
        for (let i = 0; i < xs.length; ++i) {
            if (xs[i] === null || ys[i] === null) { down = false; continue; }
            const x = u.valToPos(xs[i], "x", true), y = u.valToPos(ys[i], "y", true);
            if (line.width) down ? stroke.lineTo(x, y) : stroke.moveTo(x, y);
            down = true;
            if (!line.marker) continue;
            const into = line.hollow ? stroke : marks;
            into.moveTo(x + radius, y);
            into.arc(x, y, radius, 0, 2 * Math.PI);
        }
        return {stroke, fill: line.marker && !line.hollow ? marks : null, clip: null, flags: 3};
    };
}

class Panel {
    constructor(chart, data) {
        Object.assign(this, {chart, data});
        for (const each of [...data.lines, ...data.areas]) {
            each.x = unpacked(each.x, data.x.log);
            each.y = unpacked(each.y, data.y.log);
        }
        this.box = element("div", {class: "panel", role: "img"});
        this.read = element("div", {class: "read", hidden: ""});
        if (data.title) this.box.append(element("div", {class: "name"}, data.title));
    }

    words() {
        const names = [...new Set(this.data.lines.map(line => line.name).filter(Boolean))];
        return [this.data.title, `${this.data.y.label || "curve"} against ${this.bottom().label}`, names.join(", ")].filter(Boolean).join("; ");
    }

    /** The horizontal axis whose label belongs to this panel: its own, or that of the last panel that shares it. */
    bottom() {
        const {x} = this.data;
        return x.label ? x : {...x, label: this.chart.panels.findLast(({data}) => data.x.group === x.group && data.x.label)?.data.x.label ?? ""};
    }

    axis(which) {
        const {label, ticks, words, log} = this.data[which], side = which === "x";
        const fixed = ticks && ((u, k, min, max) => ticks[0].filter(at => at >= min * (min > 0 ? 0.999 : 1.001) && at <= max * (max > 0 ? 1.001 : 0.999)));
        const enough = (u, k, min, max) => words || fixed(u, k, min, max).length > 1;
        const plain = log ? {} : {splits: undefined};
        const axis = {
            label: label || undefined, labelSize: 20, labelGap: 0, labelFont: FONT, font: FONT, stroke: ink, size: side ? 30 : this.chart.room(this.data.place[1]),
            gap: 4, grid: {stroke: faint, width: 0.5}, ticks: {stroke: faint, width: 0.5, size: 4}, space: side ? 56 : 26, ...plain,
            values: (u, splits) => splits.map(at => at === null ? "" : shownTick(at, log)),
        };
        if (ticks) {
            const labels = {};
            ticks[0].forEach((at, k) => { labels[at] = ticks[1][k]; });
            axis.values = (u, splits) => splits.map(at => at === null ? "" : labels[at] ?? shownTick(at, log));
            axis.splits = (u, k, min, max, step, space) => enough(u, k, min, max) ? fixed(u, k, min, max) : even(min, max);
            axis.filter = (u, splits) => splits;
        } else if (log) {
            axis.splits = (u, k, min, max) => decades(min, max);
            axis.filter = (u, splits) => splits;
        }
        return axis;
    }

    /** Width of the longest number or word along the vertical axis. */
    wide() {
        const words = this.data.y.ticks?.[1] ?? this.data.y.range.map(value => shown(value));
        return Math.min(22 + 7.5 * Math.max(4, ...words.map(text => text.length)), 150);
    }

    /** Create the plot in the available width. */
    show() {
        const {data, chart} = this, range = which => () => this[which];
        this.x = [...data.x.range];
        this.y = [...data.y.range];
        const reversed = which => data[which].range[0] > data[which].range[1];
        for (const which of ["x", "y"]) if (reversed(which)) this[which].reverse();
        const series = data.lines.map(line => ({
            label: line.name, show: !chart.off.has(line.name), paths: drawn(line), points: {show: false}, dash: line.dash,
            stroke: () => line.color || ink(), fill: () => line.color || ink(), width: line.width || (line.hollow ? 1 : 0.01),
            facets: [{scale: "x", auto: false}, {scale: "y", auto: false}],
        }));
        const empty = {paths: () => null, points: {show: false}, facets: [{scale: "x", auto: false}, {scale: "y", auto: false}]};
        this.plot = new uPlot({
            mode: 2, ...this.room(), legend: {show: false}, padding: [8, 12, 0, 0],
            cursor: {
                points: {show: false}, dataIdx: () => null, focus: {prox: -1},
                drag: {x: true, y: true, uni: 30, setScale: false},
                bind: {dblclick: () => () => chart.whole()},
                sync: {key: `${chart.key}-${data.x.group}`, scales: ["x", null]},
            },
            scales: {x: {time: false, distr: data.x.log ? 3 : 1, dir: reversed("x") ? -1 : 1, auto: false, range: range("x")},
                     y: {distr: data.y.log ? 3 : 1, dir: reversed("y") ? -1 : 1, auto: false, range: range("y")}},
            axes: [{...this.axis("x"), side: 2}, {...this.axis("y"), side: 3}],
            series: [null, ...(series.length ? series : [empty])],
            hooks: {drawAxes: [u => this.under(u)], draw: [u => this.over(u)], setCursor: [u => this.tell(u)], setSelect: [u => this.select(u)]},
        }, [null, ...(data.lines.length ? data.lines.map(({x, y}) => [x, y]) : [[[], []]])], this.box);
        this.box.append(this.read);
    }

    room() {
        return {width: Math.max(this.box.clientWidth, 200), height: Math.round(Math.max(this.data.height * INCH, 120)) + (this.data.x.label ? 20 : 0)};
    }

    resize() {
        const {width, height} = this.room();
        if (this.plot && (width !== this.plot.width || height !== this.plot.height)) this.plot.setSize({width, height});
    }

    /** Draw bands, areas and levels below the curves. */
    under(u) {
        const {ctx, bbox: {left, top, width, height}} = u, {off} = this.chart;
        ctx.save();
        ctx.beginPath();
        ctx.rect(left, top, width, height);
        ctx.clip();
        for (const band of this.data.bands.filter(({name}) => !off.has(name))) {
            ctx.fillStyle = band.color;
            for (const range of band.ranges) {
                const [from, to] = range.map(value => u.valToPos(value, band.axis, true));
                if (band.axis === "x") ctx.fillRect(Math.min(from, to), top, Math.abs(to - from), height);
                else ctx.fillRect(left, Math.min(from, to), width, Math.abs(to - from));
            }
        }
        for (const area of this.data.areas) {
            ctx.fillStyle = area.color;
            ctx.beginPath();
            area.x.forEach((x, i) => ctx.lineTo(u.valToPos(x, "x", true), u.valToPos(area.y[i], "y", true)));
            ctx.fill();
        }
        for (const level of this.data.levels.filter(({name}) => !off.has(name))) {
            const at = u.valToPos(level.at, level.axis, true);
            ctx.strokeStyle = level.color || ink();
            ctx.lineWidth = level.width * devicePixelRatio;
            ctx.setLineDash((level.dash ?? []).map(length => length * devicePixelRatio));
            ctx.beginPath();
            ctx.moveTo(level.axis === "x" ? at : left, level.axis === "x" ? top : at);
            ctx.lineTo(level.axis === "x" ? at : left + width, level.axis === "x" ? top + height : at);
            ctx.stroke();
        }
        ctx.restore();
    }

    /** Draw texts above the curves. */
    over(u) {
        const {ctx, bbox: {left, top, width, height}} = u;
        ctx.save();
        ctx.font = `${11 * devicePixelRatio}px ${FONT.slice(5)}`;
        for (const {text, at, share, align, base, color} of this.data.texts) {
            const [x, y] = at ? [u.valToPos(at[0], "x", true), u.valToPos(at[1], "y", true)]
                : [left + share[0] * width, top + (1 - share[1]) * height];
            if (x < left || x > left + width || y < top || y > top + height) continue;
            ctx.fillStyle = color || ink();
            ctx.textAlign = align;
            ctx.textBaseline = {top: "top", center: "middle", center_baseline: "middle"}[base] ?? "alphabetic";
            ctx.fillText(text, x, y - (base === "bottom" ? 3 * devicePixelRatio : 0));
        }
        ctx.restore();
    }

    select(u) {
        const {left, top, width, height} = u.select;
        if (width < 4 && height < 4) return;
        if (width >= 4 && (width < u.over.clientWidth || height === u.over.clientHeight)) {
            this.chart.zoom("x", this.data.x.group, [u.posToVal(left, "x"), u.posToVal(left + width, "x")]);
        }
        if (height >= 4 && height < u.over.clientHeight) {
            this.chart.zoom("y", this.data.y.group, [u.posToVal(top + height, "y"), u.posToVal(top, "y")]);
        }
        u.setSelect({left: 0, top: 0, width: 0, height: 0}, false);
    }

    to(which, [from, to]) {
        this[which] = from < to ? [from, to] : [to, from];
        const [min, max] = this[which];
        this.plot.setScale(which, {min, max});
    }

    /** Show the values under the cursor, of a closed curve those of its nearest point. */
    tell(u) {
        const {left, top, event} = u.cursor;
        if (!(left >= 0) || !event || !u.over.contains(event.target)) {
            this.read.hidden = true;
            return;
        }
        const at = u.posToVal(left, "x"), rows = [];
        this.data.lines.forEach((line, k) => {
            if (!u.series[k + 1].show) return;
            const value = line.loop || !line.width ? nearest(u, line, left, top) : between(line, at, this.data);
            if (value !== null) rows.push([line, value]);
        });
        const unit = /\[(.*)\]/.exec(this.bottom().label)?.[1] ?? "";
        this.read.replaceChildren(element("div", {class: "at"}, `${shown(at)} ${unit}`));
        for (const [line, value] of rows.slice(0, 14)) {
            const mark = element("i", {style: `background:${line.color || "var(--text)"}`});
            this.read.append(element("div", {}, mark, `${line.name || this.data.y.label.replace(/ *\[.*/, "") || "value"} `, element("b", {}, value)));
        }
        this.read.hidden = !rows.length;
        const right = left > u.over.clientWidth / 2, gap = 14;
        const x = u.over.offsetLeft + left + (right ? -gap - this.read.offsetWidth : gap);
        this.read.style.left = `${Math.max(0, x)}px`;
        this.read.style.top = `${u.root.offsetTop + 8}px`;
    }
}

/** A figure of the page: its panels, arranged as in the picture. */
class Chart {
    constructor(figure, key) {
        const data = JSON.parse(figure.querySelector("script").textContent);
        Object.assign(this, {figure, key, off: new Set()});
        this.panels = data.panels.map(panel => new Panel(this, panel));
        this.panels.forEach(panel => panel.box.setAttribute("aria-label", panel.words()));
        this.box = element("div", {class: "live", role: "group", "aria-label": figure.querySelector("svg").getAttribute("aria-label")});
        this.reset = element("button", {type: "button", class: "reset", hidden: ""}, "whole range");
        this.reset.addEventListener("click", () => this.whole());
        this.box.append(this.legend(data.names), this.grid());
        figure.querySelector(".still").after(this.box);
        figure.classList.add("is-live");
        this.panels.forEach(panel => panel.show());
        new ResizeObserver(() => this.panels.forEach(panel => panel.resize())).observe(this.box);
    }

    grid() {
        const grid = element("div", {class: "panels"}), rows = new Map();
        for (const panel of this.panels) {
            const [row] = panel.data.place;
            if (!rows.has(row)) rows.set(row, grid.appendChild(element("div", {class: "row"})));
            panel.box.style.flex = `${panel.data.share} 1 0`;
            rows.get(row).append(panel.box);
        }
        return grid;
    }

    legend(order) {
        const box = element("div", {class: "toggles", role: "group", "aria-label": "curves"}), looks = new Map();
        const every = this.panels.flatMap(({data}) => [...data.lines, ...data.levels, ...data.bands]).filter(({name}) => name);
        for (const each of every) if (!looks.has(each.name)) looks.set(each.name, each);
        const named = [...order.filter(name => looks.has(name)), ...[...looks.keys()].filter(name => !order.includes(name))];
        for (const name of named) {
            const {color, width, dash, marker, ranges} = looks.get(name), line = color || "var(--text)";
            const swatch = element("i", {class: ranges ? "band" : width ? (dash ? "dashed" : "") : "dot", style: `--swatch:${line};--thick:${Math.min(Math.max(width || 2, 1.5), 4)}px`});
            const button = element("button", {type: "button", "aria-pressed": "true"}, swatch, name);
            button.addEventListener("click", () => this.toggle(name, button));
            box.append(button);
        }
        box.append(this.reset);
        return box;
    }

    toggle(name, button) {
        const show = this.off.has(name);
        show ? this.off.delete(name) : this.off.add(name);
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

    /** Width left of a column of panels, the same for all panels in it. */
    room(column) {
        return Math.max(...this.panels.filter(({data}) => data.place[1] === column).map(panel => panel.wide()));
    }

    redraw() {
        this.panels.forEach(({plot}) => plot.redraw(false, true));
    }
}

const charts = [], waiting = new IntersectionObserver(entries => {
    for (const {target, isIntersecting} of entries) {
        if (!isIntersecting) continue;
        waiting.unobserve(target);
        charts.push(new Chart(target, `figure-${charts.length}`));
    }
}, {rootMargin: "400px"});
document.querySelectorAll("figure.curves").forEach(figure => waiting.observe(figure));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => charts.forEach(chart => chart.redraw()));
