// Files and folders that are dropped, and several that are chosen, go to the page's upload field one
// after another. A file of a folder is named KEY/FOLDER/PATH, and KEY/FOLDER/ when all are there.
const KNOWN = /\.(SUFFIXES)$/i;
const PAUSE = 50;
const BOX = "Say what should change";
const ICONS = { "list-search": "commands (Ctrl-K)", adjustments: "settings of the view" };
let sending = Promise.resolve();

const field = () => document.querySelector('input[type="file"]');
const later = (milliseconds) => new Promise((again) => setTimeout(again, milliseconds));

// How many files of a drop have come is told in one line.
const told = document.createElement("div");
told.id = "sending";
told.setAttribute("role", "status");

async function send(file, number = 1, count = 1) {
  const input = field();
  if (!input) return;
  told.textContent = `Sending ${number} of ${count}: ${file.name.split("/").at(-1) || "done"}`;
  document.body.append(told);
  const one = new DataTransfer();
  one.items.add(file);
  input.files = one.files;
  input.dispatchEvent(new Event("change", { bubbles: true }));
  const button = input.parentElement.querySelector("button");
  do await later(PAUSE);
  while (button.disabled);
  if (number === count) told.remove();
}

async function filesBelow(entry, path) {
  if (entry.isFile) {
    const known = KNOWN.test(entry.name) && !entry.name.startsWith(".");
    return known ? [[path, await new Promise((...found) => entry.file(...found))]] : [];
  }
  const reader = entry.createReader();
  const all = [];
  let some;
  do all.push(...(some = await new Promise((...found) => reader.readEntries(...found))));
  while (some.length); // a hundred at most each time
  all.sort((a, b) => a.name.localeCompare(b.name));
  const found = [];
  for (const each of all) {
    if (!each.name.startsWith(".")) found.push(...(await filesBelow(each, `${path}/${each.name}`)));
  }
  return found;
}

async function sendFolder(entry) {
  const files = await filesBelow(entry, entry.name);
  let key = 7; // of what is in it: the same folder, dropped again, goes on where it was
  for (const [path, file] of files) {
    const known = `${path}:${file.size}:${file.lastModified}`;
    for (const letter of known) key = (key * 31 + letter.codePointAt(0)) >>> 0;
  }
  const place = key.toString(16).padStart(8, "0");
  files.push([`${entry.name}/`, " "]);
  for (const [i, [path, file]] of files.entries())
    await send(new File([file], `${place}/${path}`), i + 1, files.length);
}

const queued = (work) => (sending = sending.then(work).catch((error) => console.warn(error)));

addEventListener("dragover", (event) => event.preventDefault());
addEventListener("drop", (event) => {
  event.preventDefault();
  for (const item of [...event.dataTransfer.items]) {
    const entry = item.webkitGetAsEntry?.(); // to be asked for before this function ends
    const file = item.getAsFile();
    if (entry?.isDirectory) queued(() => sendFolder(entry));
    else if (file) queued(() => send(file));
  }
});
addEventListener(
  "change",
  (event) => {
    if (event.target !== field() || event.target.files.length < 2) return;
    event.stopPropagation();
    const files = [...event.target.files];
    for (const [i, file] of files.entries()) queued(() => send(file, i + 1, files.length));
  },
  true,
);

// A finger on the picture is captured by it from the start, which viser takes for a handle that is
// being dragged: a tap would not be a click.
addEventListener(
  "pointerdown",
  (event) => {
    if (event.pointerType === "touch" && event.target.tagName === "CANVAS")
      event.target.releasePointerCapture(event.pointerId);
  },
  true,
);

// The scene is not drawn by the browser: its warning that it has no graphics card is of no use.
new MutationObserver((_, observer) => {
  const told = [...document.querySelectorAll('[role="alert"]')];
  const warning = told.find((each) => each.innerText.startsWith("Software WebGL"));
  if (!warning) return;
  observer.disconnect();
  warning.querySelector("button").click();
}).observe(document, { childList: true, subtree: true });

// The upload field takes several files. In a narrow window, whose panel is a sheet at the bottom, the
// picture ends where the panel begins.
let sheet = null;
new MutationObserver(() => {
  const input = field();
  if (input) input.multiple = true;
  const found = document.querySelector('[style*="position: fixed"][style*="bottom: 0px"]');
  const canvas = document.querySelector("canvas");
  if (!found || !canvas || found === sheet) return;
  sheet = found;
  sheet.id = "sheet";
  const box = [...sheet.parentElement.children].find((each) => each.contains(canvas));
  new ResizeObserver(() => {
    box.style.height = `calc(100% - ${found.offsetHeight}px)`; // 0 once it is gone
  }).observe(found);
}).observe(document, { childList: true, subtree: true });

// Buttons and chips of the panels are plain HTML: what is pressed goes to a hidden field, by whose
// value the page does it. A number makes every press another value.
let presses = 0;
const write = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set;

function act(action) {
  const label = [...document.querySelectorAll("label")].find((each) => each.textContent === "action");
  const input = label?.closest("div[class]")?.parentElement.parentElement.querySelector("input");
  if (!input) return;
  write.call(input, `${action}\t${++presses}`);
  input.dispatchEvent(new Event("input", { bubbles: true }));
}

// The tabs stay in sight while the panel scrolls: what they lie in gives its place to the panel, in
// which they stick, and a press brings what is below them into sight.
function keepTabs() {
  const list = document.querySelector('[role="tablist"]:not([data-kept])');
  const area = list?.closest(".mantine-ScrollArea-viewport");
  if (!area) return;
  list.dataset.kept = "";
  let each = list.parentElement;
  const first = list.getBoundingClientRect().top;
  for (; each !== area; each = each.parentElement)
    each.dataset.holds = Math.abs(each.getBoundingClientRect().top - first) < 2 ? "tabs" : "all";
  const shown = (event) => {
    const chosen = event.isTrusted && event.target.closest('[role="tab"]');
    if (!chosen || (event.type === "keydown" && !["Enter", " "].includes(event.key))) return;
    const reveal = () => {
      const above = list.previousElementSibling ?? list.closest('[data-holds="all"]');
      const panel = [...area.querySelectorAll('[data-holds="tabs"] > :not([role="tablist"])')].find(
        (other) => other.offsetHeight,
      );
      (panel ?? above).scrollIntoView({ block: "start" });
    };
    for (const after of [PAUSE, 10 * PAUSE]) setTimeout(reveal, after); // once it is there
  };
  for (const kind of ["click", "keydown"]) list.addEventListener(kind, shown);
}
new MutationObserver(keepTabs).observe(document, { childList: true, subtree: true });

const holds = (on) => act(`before ${on ? 1 : 0}`);
const types = (target) => target.matches?.("input, textarea, select, [contenteditable]");
addEventListener("click", (event) => {
  const found = event.target.closest?.("button[data-do]");
  if (!found) return;
  act(found.dataset.do);
  // a key's press goes on in the box: the button goes away
  if (!event.detail && /^(object|say|none) ?/.test(found.dataset.do))
    document.querySelector("[data-box]")?.focus();
});
addEventListener("change", (event) => {
  const { dataset, value } = event.target;
  if (dataset?.do) act(`${dataset.do} ${value}`);
});
let held = false;
function hold(on) {
  if (held !== on) holds((held = on));
}
addEventListener("pointerdown", (event) => hold(!!event.target.closest?.("[data-hold]")));
addEventListener("pointerup", () => hold(false));
addEventListener("keydown", (event) => {
  const button = event.target.closest?.("[data-hold]") && [" ", "Enter"].includes(event.key);
  const plain = !event.ctrlKey && !event.metaKey && !event.altKey;
  if (button || (event.key.toLowerCase() === "b" && plain && !types(event.target))) hold(true);
  if (event.key === "Enter" && plain && event.target.closest?.("[data-box]")) act("apply");
  if (event.key === "Escape" && event.target.closest?.("[data-box]")) act("end");
});
addEventListener("keyup", () => hold(false));

// What is laid over the picture is moved out of the panel; fields and buttons get their names, for
// they are known by their places alone.
const over = document.createElement("div");
over.id = "over";
over.setAttribute("role", "group");
over.setAttribute("aria-label", "objects of the scene");
new MutationObserver(() => {
  const canvas = document.querySelector("canvas");
  if (canvas && !over.isConnected) document.body.append(over);
  for (const each of document.querySelectorAll("canvas:not([aria-label])")) {
    each.setAttribute("role", "img");
    each.setAttribute("aria-label", "the scene: drag to turn, right drag to shift, wheel to zoom");
  }
  const laid = canvas && document.querySelector(".laid");
  if (laid) {
    const html = laid.innerHTML;
    if (over.dataset.html !== html) over.innerHTML = over.dataset.html = html;
    const box = canvas.getBoundingClientRect();
    const place = `left:${box.left}px;top:${box.top}px;width:${box.width}px;height:${box.height}px`;
    if (over.style.cssText !== place) over.style.cssText = place;
  }
  // without a scene there is nothing to select and no use for tools
  const bare = !!document.querySelector(".laid.nothing");
  const tabs = [...document.querySelectorAll('[role="tab"]')];
  if (tabs.length > 2 && bare !== document.body.classList.contains("bare")) {
    document.body.classList.toggle("bare");
    const enter = new KeyboardEvent("keydown", { key: "Enter", bubbles: true });
    tabs.at(bare ? -1 : 0).dispatchEvent(enter);
  }
  for (const each of document.querySelectorAll('[role="alert"]')) {
    if (!/^(Received|Uploading) /.test(each.innerText)) continue; // told by us
    each.style.display = "none";
    if (!/^Uploading/.test(each.innerText) || /success/.test(each.innerText))
      each.querySelector("button")?.click();
  }
  for (const label of document.querySelectorAll("label[for]")) {
    const row = label.closest("div[class]")?.parentElement.parentElement;
    const name = label.textContent;
    if (name === "action") row.hidden = true;
    for (const field of row?.querySelectorAll("input, textarea") ?? []) {
      if (!field.hasAttribute("aria-label")) field.setAttribute("aria-label", name);
      if (name === BOX && !field.dataset.box) {
        field.dataset.box = field.placeholder = "turn it into bronze";
        row.classList.add("box-row");
      }
    }
  }
  for (const each of document.querySelectorAll('input[value^="ws"]:not([aria-label])'))
    each.setAttribute("aria-label", "address of the page");
  for (const each of document.querySelectorAll("button:not([aria-label])")) {
    const icon = /list-search|adjustments/.exec(each.querySelector("svg")?.getAttribute("class"));
    if (!each.innerText.trim())
      each.setAttribute("aria-label", (each.title ||= ICONS[icon?.[0]] ?? "panel"));
  }
}).observe(document, { childList: true, subtree: true, characterData: true });
