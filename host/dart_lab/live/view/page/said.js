"use strict";
// List of notices, newest first. A notice that repeats the newest one, apart from numbers, is counted.
const Notices = (() => {
  const MAX_NOTICES = 100, list = document.getElementById("said");
  return {
    add(text) {
      list.parentElement.hidden = false;
      const kind = text.replace(/[\d.]+/g, "#"), newest = list.firstChild, repeated = newest !== null && newest.kind === kind;
      const item = repeated ? newest : document.createElement("li");
      item.kind = kind;
      item.count = repeated ? item.count + 1 : 1;
      item.textContent = `${new Date().toLocaleTimeString()}  ${text}${repeated ? `  (${item.count} times)` : ""}`;
      if (!repeated) list.prepend(item);
      while (list.children.length > MAX_NOTICES) list.lastChild.remove();
    },
  };
})();
