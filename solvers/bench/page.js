"use strict";
(() => {
  // More rows than this are laid out on demand only, because ten thousand take a second.
  const MOST = 200;
  const words = new Intl.Collator("en", { numeric: true, sensitivity: "base" });
  const count = (number) => number.toLocaleString("en");

  const value = (cell) => {
    if (!cell.hasAttribute("data-v")) return cell.textContent;
    return cell.dataset.v === "" ? null : Number(cell.dataset.v);
  };
  const compare = (a, b, way) => {
    if (a === null || b === null) return (a === null) - (b === null); // empty cells last, both ways
    return way * (typeof a === "number" ? a - b : words.compare(a, b));
  };

  const makeTable = (table) => {
    const body = table.tBodies[0];
    const heads = [...table.tHead.rows[0].cells];
    const rows = [...body.rows].map((row, order) => ({
      row,
      order,
      values: [...row.cells].map(value),
      text: row.textContent.toLowerCase(),
      backend: row.dataset.backend,
      ended: row.dataset.ended,
    }));
    const box = table.closest("[data-table]");
    const status = box && box.querySelector("[data-shown]");
    const more = box && box.querySelector("[data-more]");
    let all = !box;
    let matching = rows;

    const show = () => {
      const shown = all ? matching : matching.slice(0, MOST);
      body.replaceChildren(...shown.map((entry) => entry.row));
      if (!box) return;
      status.textContent = `${count(shown.length)} of ${count(rows.length)} rows shown`;
      more.hidden = shown.length === matching.length;
      more.textContent = `Show all ${count(matching.length)}`;
    };
    const sort = (column) => {
      const way = heads[column].getAttribute("aria-sort") === "ascending" ? -1 : 1;
      heads.forEach((head) => head.setAttribute("aria-sort", "none"));
      heads[column].setAttribute("aria-sort", way > 0 ? "ascending" : "descending");
      const by = (a, b) => compare(a.values[column], b.values[column], way) || a.order - b.order;
      rows.sort(by);
      matching = [...matching].sort(by);
      show();
    };
    heads.forEach((head, column) => {
      head.querySelector("button").addEventListener("click", () => sort(column));
    });
    if (more) more.addEventListener("click", () => { all = true; show(); });
    return {
      filter(keep) {
        all = all && rows.length <= MOST;
        matching = rows.filter(keep);
        show();
        return matching;
      },
    };
  };

  document.querySelectorAll("table.plain").forEach(makeTable);
  const answers = [...document.querySelectorAll("[data-problem]")].map((section) => ({
    section,
    problem: section.dataset.problem,
    table: makeTable(section.querySelector("table.answers")),
    instances: [...section.querySelectorAll("details[data-instance]")],
  }));
  const form = document.querySelector("form.filters");
  const output = form.querySelector("[data-count]");
  const total = output.textContent;
  const filter = () => {
    const text = form.elements.text.value.trim().toLowerCase();
    const [problem, backend, ended] = ["problem", "backend", "ended"].map((name) => form.elements[name].value);
    let matches = 0;
    for (const answer of answers) {
      const visible = !problem || answer.problem === problem;
      answer.section.hidden = !visible;
      const rows = answer.table.filter((row) => visible && row.text.includes(text)
        && (!backend || row.backend === backend) && (!ended || row.ended === ended));
      const named = new Set(rows.map((row) => row.values[0]));
      for (const instance of answer.instances) instance.hidden = !named.has(instance.dataset.instance);
      matches += rows.length;
    }
    output.textContent = `${count(matches)} of ${total} match`;
  };
  form.addEventListener("input", filter);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => setTimeout(filter));
  filter();
})();
