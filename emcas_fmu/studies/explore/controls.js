"use strict";
/* The fields of the page: sliders with numbers for the main values, and a searchable list of all values. */

/** The range of a slider [SI]: a declared one; up to three times a value above zero, except in °C; all values of a
    limited range; otherwise null. */
function sliderRange({range, unit, value, minimum, maximum}) {
    if (range) return range;
    if (value > 0 && unit !== "degC" && !(maximum - minimum <= 4 * value)) {
        return [Math.max(minimum, 0), Math.min(maximum, 3 * value)];
    }
    return maximum - minimum <= 400 ? [minimum, maximum] : null;
}

/** A control's title, otherwise its name in words. */
function titleOf({name, title}) {
    return title ?? name.replace(/^controller\./, "").replace(/[._]/g, " ").replace(/^./, first => first.toUpperCase());
}

class Control {
    /** Calls `change(name, value)` with values that the user sets, in SI. */
    constructor(control, change, slider = false) {
        this.control = control;
        this.change = value => change(control.name, value);
        [this.unit, this.factor] = control.shown;
        const id = `${slider ? "first" : "all"}-${control.name}`, title = titleOf(control);
        this.flag = control.kind === "Boolean";
        this.field = element("input", this.flag ? {id, type: "checkbox"} :
            {id, type: "text", inputmode: "decimal", autocomplete: "off", spellcheck: "false"});
        this.field.addEventListener("change", () => this.entered());
        this.again = element("button", {type: "button", class: "again", "aria-label": `${title}: back to its start`,
            title: "back to its start"}, "↺");
        this.again.addEventListener("click", () => {
            this.range = null;
            this.change(undefined);
            this.field.focus();
        });
        const parts = control.name.split(/(?<=[._])/).flatMap(part => [part, element("wbr")]);
        this.row = element("div", {class: "control", "data-name": control.name},
            element("label", {for: id}, slider ? title : element("code", {}, ...parts)),
            element("span", {class: "number"}, this.field, element("span", {class: "unit"}, this.unit), this.again));
        if (slider) this.addSlider(title);
        else this.row.append(element("p", {class: "about"}, ...this.about()));
    }

    /** Description, limits and source. */
    about() {
        const {description, minimum, maximum, source} = this.control;
        const limits = [minimum, maximum].map(limit => shownNumber(limit / this.factor)).join(" to ");
        const limited = Number.isFinite(minimum) && Number.isFinite(maximum) ? ` · ${limits}` : "";
        const from = source === "estimate" ? element("em", {}, source) : source ?? "";
        return [description, limited, source ? " · " : "", from];
    }

    addSlider(title) {
        this.row.title = [this.control.description, this.control.source].filter(Boolean).join(" · ");
        if (this.flag) return;
        this.slider = element("input", {type: "range", "aria-label": title});
        this.ends = [0, 1].map(() => element("span", {class: "end"}));
        this.slide = element("div", {class: "slide"}, this.ends[0], this.slider, this.ends[1]);
        this.slider.addEventListener("input", () =>
            this.change(Number(general(Number(this.slider.value), 4)) * this.factor));
        this.row.append(this.slide);
    }

    /** Moves the slider to a value; hides it if it has no range. */
    slideTo(value, text) {
        this.range ??= sliderRange({...this.control, value: this.start});
        this.slide.hidden = !this.range;
        if (!this.range) return;
        const ends = this.range.map(limit => limit / this.factor), [min, max] = ends;
        Object.assign(this.slider, {min, max, step: (max - min) / 200, value: value / this.factor});
        this.slider.setAttribute("aria-valuetext", `${text} ${this.unit}`);
        this.ends.forEach((end, k) => { end.textContent = shownNumber(ends[k]); });
    }

    /** Widens the slider's range to an accepted value. */
    widen(setting) {
        if (!this.slider) return;
        const value = setting.get(this.control.name), range = this.range ?? sliderRange({...this.control, value});
        if (!range || this.range && value >= range[0] && value <= range[1]) return;
        this.range = [Math.min(range[0], value), Math.max(range[1], value)];
        this.show(setting);
    }

    /** Reads the field; a text that is not a number is passed on, to be refused. */
    entered() {
        if (this.flag) return this.change(this.field.checked);
        const text = this.field.value.trim(), value = Number(text.replace(",", ".").replace("−", "-"));
        return this.change(text === "" ? undefined : Number.isNaN(value) ? text : value * this.factor);
    }

    /** Shows a setting's value. */
    show(setting) {
        const {name, minimum, maximum} = this.control, value = setting.get(name), start = setting.default(name);
        if (start !== this.start) this.range = null;  // another kind's start
        this.start = start;
        this.row.classList.toggle("changed", value !== start);
        this.again.hidden = value === start;
        this.field.checked = value === true;
        if (this.flag) return;
        this.field.setAttribute("aria-invalid", String(!(value >= minimum && value <= maximum)));
        const text = typeof value === "string" ? value : general(value / this.factor, 9);
        if (document.activeElement !== this.field || Number(this.field.value) !== Number(text)) this.field.value = text;
        if (this.slider && typeof value === "number") this.slideTo(value, text);
    }
}

/** The main controls in groups: the excitation's fields, supply, temperature, gains. */
function firstControls(change) {
    return Object.entries({command: DATA.fields.map(({name}) => name), ...DATA.first}).flatMap(([group, names]) => {
        const box = document.getElementById(`group-${group}`);
        const controls = names.map(name => new Control(CONTROLS.get(name), change, true));
        box.append(...controls.map(({row}) => row));
        box.hidden = !names.length;
        return controls;
    });
}

/** Controls of all parameters and constant inputs, grouped by the first word of their names; `search` filters them. */
function allControls(change, search, box) {
    const groups = new Map();
    for (const control of [...DATA.parameters, ...HELD]) {
        const group = HELD.includes(control) ? "inputs held" : control.name.split(".")[0];
        groups.set(group, [...groups.get(group) ?? [], new Control(control, change)]);
    }
    const details = [...groups].map(([group, controls]) => {
        const count = element("span", {class: "quiet"}, ` ${controls.length}`), rows = controls.map(({row}) => row);
        return [element("details", {}, element("summary", {}, group, count), ...rows), rows];
    });
    box.append(...details.map(([folded]) => folded));
    search.addEventListener("input", () => {
        const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
        for (const [folded, rows] of details) {
            for (const row of rows) row.hidden = !words.every(word => row.textContent.toLowerCase().includes(word));
            folded.hidden = rows.every(row => row.hidden);
            folded.open = words.length > 0 && !folded.hidden;
        }
    });
    return [...groups.values()].flat();
}
