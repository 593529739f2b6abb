// What scrolls sideways has the keyboard's focus. Lists within the navigation have names; buttons beside code are no
// landmark.
const BOXES = ".md-typeset__scrollwrap, .md-typeset pre > code";
function settle() {
    for (const box of document.querySelectorAll(BOXES)) box.tabIndex = box.scrollWidth > box.clientWidth ? 0 : -1;
    for (const list of document.querySelectorAll("nav nav[aria-labelledby]")) {
        list.ariaLabel = list.querySelector(".md-nav__title").textContent.trim();
        list.removeAttribute("aria-labelledby");
    }
    for (const buttons of document.querySelectorAll("nav.md-code__nav")) buttons.role = "none";
}
new MutationObserver(settle).observe(document.body, {childList: true, subtree: true});
addEventListener("resize", settle);
settle();
