"use strict";
for (const input of document.querySelectorAll(".compare input")) {
  const move = () => input.parentElement.style.setProperty("--split", input.value + "%");
  input.addEventListener("input", move);
  move(); // a browser may bring back the value of an earlier visit
}
