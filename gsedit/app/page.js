// Files and folders that are dropped, and several that are chosen, go to the page's upload field one
// after another. A file of a folder is named KEY/FOLDER/PATH, and KEY/FOLDER/ when all are there.
const KNOWN = /\.(SUFFIXES)$/i;
const PAUSE = 50;
const BOX = "Say what should change";
let sending = Promise.resolve();

const field = () => document.querySelector('input[type="file"]');
const later = (milliseconds) => new Promise((again) => setTimeout(again, milliseconds));

async function send(file) {
  const input = field();
  if (!input) return;
  const one = new DataTransfer();
  one.items.add(file);
  input.files = one.files;
  input.dispatchEvent(new Event("change", { bubbles: true }));
  const button = input.parentElement.querySelector("button");
  do await later(PAUSE);
  while (button.disabled);
  for (const each of document.querySelectorAll('[role="alert"]')) {
    // one notice at a time: the others told of files before
    if (/^Uploading .*\n.*success/s.test(each.innerText)) each.querySelector("button")?.click();
  }
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
  for (const [path, file] of files) await send(new File([file], `${place}/${path}`));
  await send(new File([" "], `${place}/${entry.name}/`));
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
    for (const file of [...event.target.files]) queued(() => send(file));
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

const holds = (on) => act(`before ${on ? 1 : 0}`);
const types = (target) => target.matches?.("input, textarea, select, [contenteditable]");
addEventListener("click", (event) => {
  const found = event.target.closest?.("button[data-do]");
  if (found) act(found.dataset.do);
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
  for (const each of document.querySelectorAll('[role="alert"]')) {
    if (each.innerText.startsWith("Received ")) each.querySelector("button")?.click(); // told by us
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
  for (const each of document.querySelectorAll("button:not([aria-label])")) {
    if (!each.innerText.trim()) each.setAttribute("aria-label", each.title || "panel");
  }
}).observe(document, { childList: true, subtree: true, characterData: true });
