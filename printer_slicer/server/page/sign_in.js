/**
 * The form that begins a session with a key.
 */
import { submitWith } from "./buttons.js";
import { make, makeField } from "./elements.js";
import { request } from "./requests.js";
import { start } from "./status.js";

/** Return the form. */
export function makeSignIn() {
  const key = make("input", { type: "password", required: true, autocomplete: "current-password", spellcheck: false });
  const about = "On the computer of the server, open the link that it printed when it started. Elsewhere, enter a key.";
  const form = make("form", { class: "card" }, make("h2", {}, "Sign in"), make("p", {}, about), makeField("Key", key), make("button", { type: "submit", class: "main" }, "Sign in"));
  submitWith(form, async () => {
    await request("POST", "/v1/session", { key: key.value.trim() });
    key.value = "";
    await start();
  });
  return form;
}
