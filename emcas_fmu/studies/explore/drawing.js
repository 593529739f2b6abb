/* A command that the user draws in the plot of the fin angle or writes as points. It is stored as a CSV file. */

const DRAWN = "drawn command";
const NUMBER = "([-+]?(?:\\d+\\.?\\d*|\\.\\d+)(?:e[-+]?\\d+)?)";
const POINT = new RegExp(`^${NUMBER}(?:\\s*[,;]\\s*|\\s+)${NUMBER}$`, "i"); // time and angle in a line
const STRAIGHT = 1e-14; // rad, largest second difference at a row on the line between its neighbours

/** The points of a setting's CSV file, time [s] and command [rad]; if the file has other inputs, only the command's
    corners. */
function pointsOf({kind, file}) {
    if (kind !== "csv" || !file?.columns.fin_command) return [];
    if (Object.keys(file.columns).length === 1) return file.points;
    const {time, columns: {fin_command: command}} = file, last = time.length - 1;
    return Array.from(time, (t, k) => [t, command[k]]).filter((_, k) => k === 0 || k === last ||
        Math.abs(command[k - 1] - 2 * command[k] + command[k + 1]) > STRAIGHT);
}

/** The text of a CSV file with the points, and with the other inputs of the setting's file. Throws an Error. */
function drawnFile(points, {kind, file}) {
    const text = ["time,fin_command", ...points.map(point => point.join(",")), ""].join("\n");
    const {fin_command: _, ...others} = kind === "csv" && file ? file.columns : {};
    if (!Object.keys(others).length) return text;
    const {time, columns} = fromCsv(text, DRAWN), kept = Object.entries(others).map(([name, column]) =>
        [name, resampled(time, file.time, column)]);
    return csv({time, ...columns, ...Object.fromEntries(kept)});
}

/** The points, of which a stroke replaces those in its interval of time. Without points, the command is 0 before the
    stroke; if none is later than the stroke, the command stays constant until `end` [s]. */
function drawnOver(points, stroke, end) {
    const [[first], [last, level]] = [stroke[0], stroke.at(-1)];
    const [times, angles] = [0, 1].map(k => points.map(point => point[k]));
    const joint = time => [time, points.length ? resampled([time], times, angles)[0] : 0];
    const before = [...points.length ? [] : [[0, 0]], ...points.filter(([time]) => time < first), joint(first)];
    const after = points.filter(([time]) => time > last);
    return [...before, ...stroke, ...after.length ? [joint(last), ...after] : last < end ? [[end, level]] : []];
}

class Drawing {
    /** Calls `done` after a stroke over a plot or a change of the text, with a function that returns all points. */
    constructor(plot, done) {
        Object.assign(this, {plot, done, stroke: null, button: $("draw"), field: $("points")});
        this.button.addEventListener("click", () => this.turn(!this.on));
        this.field.addEventListener("change", () => done(() => this.points));
        for (const [event, action] of Object.entries({
            pointerdown: at => this.begin(at), pointermove: at => this.move(at), pointerup: () => this.end(),
            pointercancel: () => this.end(), mousedown: () => undefined})) {
            plot.box.addEventListener(event, at => {
                if (!this.on || !(this.stroke || at.target.closest(".u-over"))) return;
                at.stopPropagation();  // otherwise the drag would zoom
                action(at);
            }, true);
        }
        plot.sketch = u => this.stroke && trajectory(u, {x: this.stroke.map(([time]) => time),
            y: this.stroke.map(([, angle]) => degrees(angle)), stroke: COLORS[1]});
    }

    get on() {
        return this.button.getAttribute("aria-pressed") === "true";
    }

    /** Switches drawing on or off. While drawing is on, the plot reaches to the command's limits. */
    turn(on) {
        this.button.setAttribute("aria-pressed", String(on));
        this.plot.box.classList.toggle("drawing", on);
        this.plot.reach = on ? [-degrees(this.limit), degrees(this.limit)] : [Infinity, -Infinity];
        this.plot.chart.setData(this.plot.chart.data);
        this.show(this.setting);
    }

    show(setting) {
        this.setting = setting;
        $("points-row").hidden = !this.on && !(setting.kind === "csv" && setting.file?.title === DRAWN);
        if ($("points-row").hidden || document.activeElement === this.field) return;
        this.field.value = pointsOf(setting).map(([time, angle]) => `${time}, ${general(degrees(angle), 9)}`).join("\n");
    }

    get limit() {
        return this.setting.get("command.limit");
    }

    /** Time [s] and command [rad] under a pointer, rounded to whole steps and to 0.01°. */
    under(pointer) {
        const [x, y] = this.plot.at(pointer), limit = degrees(this.limit);
        const time = Math.min(Math.max(x, 0), this.plot.chart.data[0].at(-1));
        const angle = Math.min(Math.max(y, -limit), limit);
        return [Math.round(time / STEP) / Math.round(1 / STEP), Math.round(100 * angle) / 100 * Math.PI / 180];
    }

    begin(at) {
        this.plot.box.setPointerCapture(at.pointerId);
        this.stroke = [this.under(at)];
    }

    /** Adds a point to the stroke, and removes points that are not earlier. */
    move(at) {
        if (!this.stroke) return;
        const point = this.under(at);
        while (this.stroke.at(-1)?.[0] >= point[0]) this.stroke.pop();
        this.stroke.push(point);
        this.plot.redraw();
    }

    end() {
        const {stroke, plot: {chart}} = this;
        this.stroke = null;
        this.plot.redraw();
        if (!stroke || stroke.length < 2) return;  // a click, not a stroke
        const end = Math.round(chart.data[0].at(-1) / STEP) / Math.round(1 / STEP);
        this.done(() => drawnOver(pointsOf(this.setting), stroke, end));
    }

    /** The points [s, rad] of the text field, in which each line has a time [s] and an angle [°]. Throws an Error. */
    get points() {
        const texts = this.field.value.split("\n").map(text => text.trim());
        return texts.flatMap((text, k) => {
            if (!text) return [];
            const numbers = POINT.exec(text.replaceAll("−", "-"));
            if (numbers) return [[Number(numbers[1]), Number(numbers[2]) * Math.PI / 180]];
            throw new Error(`${DRAWN}: line ${k + 1}, '${text.slice(0, 40)}', is not a time [s] and an angle [°], ` +
                "such as 0.2, 10");
        });
    }
}
