// A session's folder, chosen or dropped: its files are read here and sent to the service, which says what is wrong.
import { post } from "../api.js";
import { el, fill, problem, quiet } from "../dom.js";

// What a session's folder may hold; whatever else lies there stays on this machine.
const WANTED = /\.(ya?ml|json|csv|csv\.gz|parquet)$/i;
const MOST_BYTES = 11 * 2 ** 20;
const PACKED_FROM = 2 ** 18;

export function importing(signal) {
  const said = el("div", { role: "status", "aria-live": "polite" });
  const name = el("input", { id: "name", placeholder: "as its description says", autocomplete: "off", pattern: "[A-Za-z0-9][A-Za-z0-9._\\-]{0,99}" });
  const folder = el("input", { id: "folder", type: "file", webkitdirectory: true, onchange: () => { const given = [...folder.files]; folder.value = ""; take(given); } });
  const drop = dropZone("or drop the folder here", take);

  async function take(files) {
    const wanted = files.filter((f) => WANTED.test(f.name));
    if (!files.length) return;
    try {
      if (!wanted.some((f) => f.name === "session.yaml")) {
        throw new Error(`There is no session.yaml among the ${files.length} files. A session's folder holds session.yaml and the readings that it names.`);
      }
      fill(said, quiet(`Reading ${wanted.length} files …`));
      const sent = [];
      let bytes = 0;
      for (const f of wanted) {
        const packed = await content(f);
        bytes += packed.byteLength;
        if (bytes > MOST_BYTES) {
          throw new Error(`The readings are more than ${MOST_BYTES / 2 ** 20} MB packed. Send a folder as large as this by the command line: fingertwin replay FOLDER --to ${location.origin}`);
        }
        sent.push({ name: f.name, base64: await base64(packed) });
      }
      fill(said, quiet(`Sending ${(bytes / 2 ** 20).toFixed(1)} MB …`), el("progress", { "aria-label": "Sending" }));
      const made = await post("/imports", { files: sent, ...(name.value.trim() ? { id: name.value.trim() } : {}) });
      if (signal.aborted) return;
      fill(said, el("p", { class: "good" }, `${made.id} is here${made.already_there ? " already; the folder is the same as before, and nothing has changed" : ""}: ${Object.entries(made.cases).map(([s, n]) => `${n} load cases ${s}`).join(", ") || "no load case"}. `,
        el("a", { href: `#/sessions/${encodeURIComponent(made.id)}/compare` }, "Compare it"), made.problem ? ` ${made.problem}` : ""));
    } catch (error) {
      fill(said, problem(error));
    }
  }

  return [quiet("Choose the folder that holds session.yaml and its readings. Nothing of it is kept unless all of it is sound."),
    el("div", { class: "row" }, el("div", {}, el("label", { htmlFor: "folder" }, "A session's folder"), folder), drop, el("div", {}, el("label", { htmlFor: "name" }, "Under another name"), name)), said];
}

/** A place to drop files or folders on, which are taken with the files that lie in them. */
export function dropZone(title, take) {
  const drop = el("div", { class: "drop" }, title);
  drop.addEventListener("dragover", (e) => { e.preventDefault(); drop.classList.add("over"); });
  drop.addEventListener("dragleave", () => drop.classList.remove("over"));
  drop.addEventListener("drop", async (e) => {
    e.preventDefault();
    drop.classList.remove("over");
    // Entries are gone once this function waits.
    const entries = [...e.dataTransfer.items].map((i) => i.webkitGetAsEntry?.()).filter(Boolean);
    const files = [...e.dataTransfer.files];
    take(entries.length ? (await Promise.all(entries.map(within))).flat() : files);
  });
  return drop;
}

/** Files of a dropped folder, without those of folders within it. */
async function within(entry) {
  const file = (e) => new Promise((resolve, reject) => e.file(resolve, reject));
  if (entry.isFile) return [await file(entry)];
  const reader = entry.createReader();
  const out = [];
  for (;;) {
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (!some.length) return out;
    out.push(...await Promise.all(some.filter((e) => e.isFile).map(file)));
  }
}

/** A file's bytes; long texts are packed, which the service takes under any name. */
export async function content(file) {
  if (file.size < PACKED_FROM || !/\.(csv|tsv|txt|dat|lvm)$/i.test(file.name)) return file.arrayBuffer();
  return new Response(file.stream().pipeThrough(new CompressionStream("gzip"))).arrayBuffer();
}

/** Bytes as the service takes them in JSON. */
export function base64(buffer) {
  return new Promise((resolve, reject) => {
    const reader = new FileReader();
    reader.onload = () => resolve(reader.result.slice(reader.result.indexOf(",") + 1));
    reader.onerror = () => reject(reader.error);
    reader.readAsDataURL(new Blob([buffer]));
  });
}
