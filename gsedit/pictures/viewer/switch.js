// Buttons of a page that gsedit view wrote: before / after, region, cameras. They set the visibility
// of viser's scene nodes, which a viser page keeps in a React context; found by its property names.
(() => {
  const page = PAGE;
  const state = { scene: page.after ? "after" : "before", region: false, cameras: false };

  const findViewer = () => {
    const root = document.getElementById("root");
    const key = root && Object.keys(root).find((k) => k.startsWith("__reactContainer$"));
    const queue = key ? [root[key].stateNode.current] : [];
    while (queue.length) {
      const fiber = queue.pop();
      const value = fiber.memoizedProps && fiber.memoizedProps.value;
      if (value && value.sceneTreeActions && value.sceneTreeActions.updateNodeAttributes) return value;
      if (fiber.sibling) queue.push(fiber.sibling);
      if (fiber.child) queue.push(fiber.child);
    }
    return null;
  };

  const apply = (viewer) => {
    const shown = page.states[`${state.scene} ${state.region}`];
    const set = (name, visibility) =>
      viewer.sceneTreeActions.updateNodeAttributes(`/${name}`, { visibility });
    for (const name of page.layers) set(name, shown.includes(name));
    if (page.cameras) set("cameras", state.cameras);
    viewer.mutable.current.requestRender();
    document.documentElement.dataset.shown = shown.join(" ");
  };

  const button = (bar, label, isOn, press) => {
    const element = document.createElement("button");
    element.textContent = label;
    element.style.cssText =
      "font: 14px sans-serif; padding: 6px 12px; border: 1px solid #888; border-radius: 4px;";
    const paint = () => {
      element.style.background = isOn() ? "#246" : "#fff";
      element.style.color = isOn() ? "#fff" : "#222";
      element.setAttribute("aria-pressed", isOn());
    };
    element.addEventListener("click", () => {
      press();
      bar.dispatchEvent(new Event("change"));
    });
    bar.addEventListener("change", paint);
    paint();
    bar.append(element);
  };

  const start = (viewer) => {
    const bar = document.createElement("div");
    bar.id = "gsedit";
    bar.style.cssText = "position: fixed; left: 12px; bottom: 12px; z-index: 5; display: flex; gap: 6px;";
    const toggle = (label, key) =>
      button(bar, label, () => state[key], () => (state[key] = !state[key]));
    if (page.after)
      for (const scene of ["before", "after"])
        button(bar, scene, () => state.scene === scene, () => (state.scene = scene));
    if (page.region) toggle("region", "region");
    if (page.cameras) toggle(`${page.cameras} cameras`, "cameras");
    bar.addEventListener("change", () => apply(viewer));
    document.body.append(bar);
    for (const word of location.hash.slice(1).split(",")) {
      if (word === "before" || (word === "after" && page.after)) state.scene = word;
      else if (word in state && word !== "scene") state[word] = true;
    }
    bar.dispatchEvent(new Event("change"));
  };

  const wait = () => {
    const viewer = findViewer();
    const node = viewer && viewer.useSceneTree.getAll()[`/${page.layers[page.layers.length - 1]}`];
    if (node) start(viewer);
    else setTimeout(wait, 200);
  };
  wait();
})();
