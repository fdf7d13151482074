<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Colour: horizontal or vertical. -->
<qgis version="3.34.0" styleCategories="Symbology|MapTips">
 <renderer-v2 type="categorizedSymbol" attr="kind" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <categories>
   <category value="horizontal" type="string" symbol="0" label="horizontal plane" render="true"/>
   <category value="vertical" type="string" symbol="1" label="vertical plane" render="true"/>
  </categories>
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="202,120,92,150"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="120,60,40,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.3"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
   <symbol type="fill" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="70,70,70,255"/>
      <Option name="style" type="QString" value="solid"/>
      <Option name="outline_color" type="QString" value="50,50,50,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.7"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <mapTip enabled="1">&lt;b&gt;[% "kind" %] plane&lt;/b&gt;, [% format_number("area_m2", 1) %] m²&lt;br&gt;top [% coalesce(format_number("height_m", 1), '?') %] m above the ground, tilt [% format_number("tilt_deg", 0) %]°</mapTip>
</qgis>
