"use strict";

// Starts the page: unpacks the viewer and the scene, or gets the scene from the server that sent the page.
const pbd = { ready: false, page: null, startup: null };
window.pbd = pbd;

function say(text) {
  const message = document.getElementById("message");
  message.textContent = text;
  message.hidden = false;
}

async function unpacked(id) {
  const packed = atob(document.getElementById(id).textContent);
  const bytes = new Uint8Array(packed.length);
  for (let i = 0; i < packed.length; i++) bytes[i] = packed.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Each command comes after its length: four bytes, little-endian.
function* commands(bytes) {
  const view = new DataView(bytes.buffer);
  for (let at = 0; at < bytes.length; ) {
    const length = view.getUint32(at, true);
    yield bytes.subarray(at + 4, at + 4 + length);
    at += 4 + length;
  }
}

function showReplay(stage, replay) {
  pbd.page?.player.pause();
  pbd.page = new Page(stage, replay);
  if (!matchMedia("(prefers-reduced-motion: reduce)").matches) pbd.page.player.play();
  requestAnimationFrame(() => setTimeout(() => {
    pbd.startup = performance.now();
    pbd.ready = true;
  }));
}

// Shows the state of a running recording.
function showRecording(stage, state) {
  pbd.page ??= new LivePage(stage);
  pbd.page.take(state);
  requestAnimationFrame(() => { pbd.ready = true; });
}

async function boot() {
  const code = document.createElement("script");
  code.textContent = new TextDecoder().decode(await unpacked("viewer-code"));
  document.head.append(code);
  const stage = new SceneView(document.getElementById("pane"));
  const handle = stage.viewer.handle_command.bind(stage.viewer);
  stage.viewer.handle_command = (command) => {
    if (command.property === "live") {
      showRecording(stage, command.value);
      return;
    }
    handle(command);
    if (command.property === "replay") showReplay(stage, command.value);
  };
  if (document.getElementById("scene").textContent) {
    for (const command of commands(await unpacked("scene"))) stage.viewer.handle_command_bytearray(command);
  } else {
    stage.viewer.connect();
    stage.viewer.connection.onclose = () => {
      if (pbd.page instanceof LivePage) pbd.page.gone();
      else say("The command has ended. To load this page again, run it again.");
    };
  }
}

boot().catch((error) => {
  console.error(error);
  say(`The replay can't be shown: ${error.message}. Use a browser of 2023 or later.`);
});
