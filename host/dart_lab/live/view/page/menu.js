"use strict";
// A menu inside the page. The menu of a browser takes the keys, so that the space bar would not stop the car, and covers
// STOP on a phone.
// `Menu.within(select)`: pointer and keys open a list of buttons; the select keeps the value and reports the change.
const Menu = (() => {
  function within(select) {
    const list = document.createElement("div");
    list.className = "list";
    list.hidden = true;
    select.after(list);
    function choose(option) {
      select.value = option.value;
      close();
      select.dispatchEvent(new Event("change"));
    }
    function open() {
      list.replaceChildren(...[...select.options].map((option) => {
        const item = document.createElement("button");
        item.textContent = option.text;
        item.onclick = () => choose(option);
        return item;
      }));
      list.hidden = false;
    }
    function close() { list.hidden = true; }
    const toggle = (event) => { event.preventDefault(); if (list.hidden) open(); else close(); };
    for (const name of ["mousedown", "touchend"]) select.addEventListener(name, toggle);
    select.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === "F4" || (event.altKey && event.code.startsWith("Arrow"))) { event.stopPropagation(); toggle(event); }
      if (event.key === "Escape") close();
    });
    addEventListener("pointerdown", (event) => { if (event.target !== select && !list.contains(event.target)) close(); });
  }
  return { within };
})();
