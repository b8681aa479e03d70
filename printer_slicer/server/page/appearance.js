/**
 * Light and dark: like the system has it, or as the user chooses.
 */
import { make, makeField } from "./elements.js";

const STORED_AS = "printer_slicer_scheme";
const CHOICES = { system: "like the system", light: "light", dark: "dark" };

/** Show the page as it was chosen last. */
export function applyAppearance() {
  document.documentElement.dataset.scheme = readChoice();
}

/** Return the menu of the appearance. */
export function makeAppearanceMenu() {
  const options = Object.entries(CHOICES).map(([value, text]) => make("option", { value }, text));
  const menu = make("select", {}, ...options);
  menu.value = readChoice();
  menu.addEventListener("change", () => {
    try {
      localStorage.setItem(STORED_AS, menu.value);
    } catch {
      // The browser stores nothing; the choice holds until the page is closed.
    }
    document.documentElement.dataset.scheme = menu.value;
  });
  return makeField("Colours", menu);
}

/** Return what was chosen last. */
function readChoice() {
  try {
    const stored = localStorage.getItem(STORED_AS);
    return stored in CHOICES ? stored : "system";
  } catch {
    return "system";
  }
}
