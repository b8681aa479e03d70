/**
 * Keys of slicers and people, the appearance of the page, and the end of the session.
 */
import { makeAppearanceMenu } from "./appearance.js";
import { makeButton, makeConfirmedButton, submitWith } from "./buttons.js";
import { make, makeCheckbox, makeField, makeList, setShown, setText } from "./elements.js";
import { formatTime } from "./formats.js";
import { fillPrinters } from "./job_form.js";
import { tell, tellError } from "./messages.js";
import { request } from "./requests.js";
import { allows, known, stop } from "./status.js";

const SCOPES = {
  read: "See everything",
  upload: "Upload files",
  print: "Change the queue",
  control: "Control prints and beds",
  admin: "Create and delete keys",
};
const SCOPES_OF_SLICERS = ["read", "upload", "print"];

/** Return the section with the settings. */
export function makeSettingsSection() {
  const name = make("span", { class: "grow" });
  const signOut = makeButton("Sign out", async () => {
    await request("DELETE", "/v1/session");
    stop();
  });
  const keys = makeKeys();
  const account = make("div", { class: "card" }, make("h3", {}, "Account"), make("div", { class: "row" }, name, signOut));
  const view = make("div", { class: "card" }, make("h3", {}, "Appearance"), makeAppearanceMenu());
  let isLoaded = false;
  return {
    title: "Settings",
    element: make("div", {}, account, view, keys.element),
    show() {
      setText(name, `Signed in as ${known.account?.name}`);
      setShown(keys.element, allows("admin"));
      keys.showPrinters();
      if (isLoaded || !allows("admin")) return;
      isLoaded = true;
      keys.load().catch(tellError);
    },
  };
}

/** Return the list of keys and the form for a new one. */
function makeKeys() {
  const list = make("ul", { class: "plain" });
  const created = make("output", { class: "key" });
  const load = async () => showKeys(await request("GET", "/v1/keys"));
  const showKeys = makeList(list, (key) => key.id, (key) => makeKeyRow(key, load));
  const showNew = (text) => {
    const copy = makeButton("Copy", () => navigator.clipboard.writeText(text));
    setShown(copy, "clipboard" in navigator); // browsers have it with https and on the computer of the server only
    created.replaceChildren(make("p", {}, "Copy this key now. It is not shown again."), make("code", { tabIndex: 0 }, text), copy);
    return load();
  };
  const { form, showPrinters } = makeKeyForm(showNew);
  const about = "Give each slicer and phone a key of its own. A deleted key no longer works.";
  const element = make("div", { class: "card" }, make("h3", {}, "Keys"), make("p", { class: "hint" }, about), list, form, created);
  return { element, load, showPrinters };
}

/** Return the row of a key. */
function makeKeyRow(key, load) {
  const used = make("p", { class: "hint" });
  const remove = makeConfirmedButton("Delete", "Press again to delete", async () => {
    await request("DELETE", `/v1/keys/${key.id}`);
    tell(`The key ${key.name} is deleted`);
    await load();
  });
  const where = key.printer ? ` · only ${key.printer}` : "";
  const texts = make("div", { class: "grow" }, make("strong", {}, key.name), make("p", {}, listScopes(key) + where), used);
  return {
    element: make("li", { class: "row" }, texts, remove),
    show: (now) => setText(used, now.used ? `last used ${formatTime(now.used)}` : "never used"),
  };
}

/** Return what a key allows as text. */
function listScopes(key) {
  return Object.keys(SCOPES)
    .filter((scope) => key.scopes.includes(scope))
    .join(", ");
}

/** Return the form that creates a key. */
function makeKeyForm(showNew) {
  const name = make("input", { required: true, maxLength: 80, autocomplete: "off" });
  const boxes = Object.entries(SCOPES).map(([scope, label]) => ({ scope, ...makeCheckbox(label, SCOPES_OF_SLICERS.includes(scope)) }));
  const scopes = make("fieldset", {}, make("legend", {}, "What it allows"), ...boxes.map((box) => box.element));
  const printer = make("select", {});
  const form = make("form", {}, makeField("Name of the new key", name), makeField("Printer", printer), scopes, make("button", { type: "submit" }, "Create key"));
  submitWith(form, async () => {
    const wanted = boxes.filter((box) => box.input.checked).map((box) => box.scope);
    const { text } = await request("POST", "/v1/keys", { name: name.value, scopes: wanted, printer: printer.value });
    name.value = "";
    await showNew(text);
  });
  return { form, showPrinters: () => fillPrinters(printer, "all printers") };
}
