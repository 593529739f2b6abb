/* The fields of the page: those of the main values, with sliders, and a searchable list of all values. */

/** The range of a slider [SI]: the declared one; otherwise up to three times a positive value that is not in °C and
    below a quarter of the distance of the limits; otherwise the limits, if at most 400 apart; otherwise null. */
function sliderRange({range, unit, value, minimum, maximum}) {
    if (range) return range;
    if (value > 0 && unit !== "degC" && !(maximum - minimum <= 4 * value)) {
        return [Math.max(minimum, 0), Math.min(maximum, 3 * value)];
    }
    return maximum - minimum <= 400 ? [minimum, maximum] : null;
}

class Control {
    /** Calls `change(name, value)` with each value [SI] that the user sets in a row of the page. */
    constructor(row, change) {
        const within = selector => row.querySelector(selector);
        Object.assign(this, {row, control: CONTROLS.get(row.dataset.name), field: within(".number input")});
        Object.assign(this, {again: within(".again"), slide: within(".slide"), slider: within("[type=range]")});
        [this.unit, this.factor] = this.control.shown;
        this.change = value => change(this.control.name, value);
        this.field.addEventListener("change", () => this.entered());
        this.slider?.addEventListener("input", () =>
            this.change(Number(general(Number(this.slider.value), 4)) * this.factor));
        this.again.addEventListener("click", () => {
            this.range = null;
            this.change(undefined);
            this.field.focus();
        });
    }

    /** Moves the slider to a value; hides it if it has no range. */
    slideTo(value, text) {
        this.range ??= sliderRange({...this.control, value: this.start});
        this.slide.hidden = !this.range;
        if (!this.range) return;
        const ends = this.range.map(limit => limit / this.factor), [min, max] = ends;
        Object.assign(this.slider, {min, max, step: (max - min) / 200, value: value / this.factor});
        this.slider.setAttribute("aria-valuetext", `${text} ${this.unit}`);
        this.slide.querySelectorAll(".end").forEach((end, k) => { end.textContent = shownNumber(ends[k]); });
    }

    /** Widens the slider's range to an accepted value outside it. */
    widen(setting) {
        if (!this.slider) return;
        const value = setting.get(this.control.name), range = this.range ?? sliderRange({...this.control, value});
        if (!range || this.range && value >= range[0] && value <= range[1]) return;
        this.range = [Math.min(range[0], value), Math.max(range[1], value)];
        this.show(setting);
    }

    /** Passes on the value in the field; a text that is not a number is refused when the setting is checked. */
    entered() {
        if (this.field.type === "checkbox") return this.change(this.field.checked);
        const text = this.field.value.trim(), value = Number(text.replace(",", ".").replace("−", "-"));
        return this.change(text === "" ? undefined : Number.isNaN(value) ? text : value * this.factor);
    }

    show(setting) {
        const {name, minimum, maximum} = this.control, value = setting.get(name), start = setting.default(name);
        if (start !== this.start) this.range = null;  // the initial value depends on the kind of excitation
        this.start = start;
        this.row.classList.toggle("changed", value !== start);
        this.again.hidden = value === start;
        this.field.checked = value === true;
        if (this.field.type === "checkbox") return;
        this.field.setAttribute("aria-invalid", String(!(value >= minimum && value <= maximum)));
        const text = typeof value === "string" ? value : general(value / this.factor, 9);
        if (document.activeElement !== this.field || Number(this.field.value) !== Number(text)) this.field.value = text;
        if (this.slider && typeof value === "number") this.slideTo(value, text);
    }
}

/** Shows, in the list of all values, only those whose text contains all words of a search. */
function searchControls(text) {
    const words = text.toLowerCase().split(/\s+/).filter(Boolean);
    for (const group of document.querySelectorAll("#controls details")) {
        const rows = [...group.querySelectorAll(".control")];
        for (const row of rows) row.hidden = !words.every(word => row.textContent.toLowerCase().includes(word));
        group.hidden = rows.every(row => row.hidden);
        group.open = words.length > 0 && !group.hidden;
    }
}
