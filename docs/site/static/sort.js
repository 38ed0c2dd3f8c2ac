// A table of class "sortable": a click on a head sorts by it, another one backwards.
const numberOrText = (cell) => {
  const value = parseFloat(cell.textContent.replace("\u2212", "-"));
  return Number.isNaN(value) ? cell.textContent : value;
};

const compare = (a, b) =>
  typeof a === "number" && typeof b === "number"
    ? a - b
    : String(a).localeCompare(String(b), "en", { numeric: true });

const sortBy = (table, head) => {
  const backwards = head.getAttribute("aria-sort") === "ascending";
  table.querySelectorAll("th").forEach((other) => other.removeAttribute("aria-sort"));
  head.setAttribute("aria-sort", backwards ? "descending" : "ascending");
  const rows = [...table.tBodies[0].rows].sort(
    (a, b) => compare(numberOrText(a.cells[head.cellIndex]), numberOrText(b.cells[head.cellIndex])),
  );
  table.tBodies[0].append(...(backwards ? rows.reverse() : rows));
};

document.addEventListener("DOMContentLoaded", () => {
  document.querySelectorAll("table.sortable").forEach((table) => {
    table.querySelectorAll("th").forEach((head) => {
      head.querySelector("button").addEventListener("click", () => sortBy(table, head));
    });
  });
});
