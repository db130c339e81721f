// Files that are dropped on the page go to its upload button, one after another.
addEventListener("dragover", (event) => event.preventDefault());
addEventListener("drop", async (event) => {
  event.preventDefault();
  const files = [...event.dataTransfer.files];
  for (const file of files) {
    const input = document.querySelector('input[type="file"]');
    if (!input) return;
    const one = new DataTransfer();
    one.items.add(file);
    input.files = one.files;
    input.dispatchEvent(new Event("change", { bubbles: true }));
    const button = input.parentElement.querySelector("button");
    do await new Promise((again) => setTimeout(again, 50));
    while (button.disabled);
  }
});

// The scene is not drawn by the browser: its warning that it has no graphics card is of no use.
new MutationObserver((_, observer) => {
  const told = [...document.querySelectorAll('[role="alert"]')];
  const warning = told.find((each) => each.innerText.startsWith("Software WebGL"));
  if (!warning) return;
  observer.disconnect();
  warning.querySelector("button").click();
}).observe(document, { childList: true, subtree: true });
