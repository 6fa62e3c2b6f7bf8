"use strict";
// What was said, the newest first; one that is said again, up to its numbers, is counted.
const Said = (() => {
  const MOST = 100, list = document.getElementById("said");
  return {
    say(text) {
      const kind = text.replace(/[\d.]+/g, "#"), newest = list.firstChild, again = newest !== null && newest.kind === kind;
      const item = again ? newest : document.createElement("li");
      item.kind = kind;
      item.count = again ? item.count + 1 : 1;
      item.textContent = `${new Date().toLocaleTimeString()}  ${text}${again ? `  (${item.count} times)` : ""}`;
      if (!again) list.prepend(item);
      while (list.children.length > MOST) list.lastChild.remove();
    },
  };
})();
